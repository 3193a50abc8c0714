// What stands before the charting library: how fine it draws, numbers in print, and where the ticks of an axis are.
"use strict";
const sharp = Math.max(2, devicePixelRatio);  // finer than a coarse screen needs: the same pixels go to paper
Object.defineProperty(window, "devicePixelRatio", { get: () => sharp });
const superscript = n => String(n).replace(/./g, c => c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]);

/** A number in print: 0.0123, or 1.23·10⁻¹⁴. */
function printed(value, digits = 4) {
  if (value === 0) return "0";
  const exponent = Math.floor(Math.log10(Math.abs(value)) + 1e-9);
  if (exponent >= -3 && exponent < 5) return String(Number(value.toPrecision(digits))).replace("-", "−");
  const mantissa = Number((value / 10 ** exponent).toPrecision(digits));
  return (mantissa === 1 ? "10" : `${mantissa}·10`.replace("-", "−")) + superscript(exponent);
}

/** A value with its uncertainty in units of the last digits: 1.077587(34), −3.983(53)·10⁻⁷. */
function concise(value, sigma) {
  const decimals = 1 - Math.floor(Math.log10(sigma));
  if (decimals >= 10) {
    const exponent = Math.floor(Math.log10(Math.max(Math.abs(value), sigma)));
    return `${concise(value / 10 ** exponent, sigma / 10 ** exponent)}·10${superscript(exponent)}`;
  }
  const places = Math.max(decimals, 0);
  return `${value.toFixed(places).replace("-", "−")}(${Math.round(sigma * 10 ** places)})`;
}

/** Ticks of an axis of dates, ISO 8601: dates or, in steps below a day, times with the date where it changes. */
function days(places, step) {
  const texts = places.map(t => new Date(t * 1e3).toISOString().split("T"));
  if (step >= 86400) return texts.map(([date]) => step >= 27 * 86400 ? date.slice(0, 7) : date);
  const isMidnight = texts.map(([, time]) => time.startsWith("00:00")), first = isMidnight.indexOf(true);
  return texts.map(([date, time], i) => time.slice(0, 5) + (isMidnight[i] || (i === 0 && (first < 0 || first > 2)) ? `\n${date}` : ""));
}

/** Round places between two values, about as many as are wanted, and no fewer than three. */
function rounds(low, high, wanted) {
  let found = [];
  for (; found.length < 3 && wanted < 50; wanted += 1) {
    const rough = (high - low) / wanted, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find(n => n * power >= rough * .999);
    found = [];
    for (let n = Math.ceil(low / step - 1e-9); n * step <= high + step * 1e-9; n++) found.push(n * step);
  }
  return found;
}

/** Powers of ten between two values with their 2 to 9; round places where they are less than a decade apart. */
function decades(low, high) {
  if (high / low < 10) return rounds(low, high, 5);
  const found = [];
  for (let n = Math.floor(Math.log10(low)); n <= Math.log10(high); n++)
    for (let m = 1; m < 10; m++)
      if (m * 10 ** n >= low * .9999 && m * 10 ** n <= high * 1.0001) found.push(m * 10 ** n);
  return found;
}

/** What stands at the ticks of an axis: every so many powers of ten, or numbers with as many digits as they need. */
function labels(axis, places, size) {
  if (axis.log && places.at(-1) / places[0] >= 10) {
    const exponents = places.map(x => Math.log10(x / axis.factor)), whole = exponents.map(Math.round);
    const span = exponents.at(-1) - exponents[0], every = Math.max(1, Math.ceil(span * 34 / size));
    return whole.map((n, i) => Math.abs(exponents[i] - n) < 1e-6 && n % every === 0 ? "10" + superscript(n) : null);
  }
  const step = Math.min(...places.slice(1).map((x, i) => x - places[i]));
  const largest = Math.max(...places.map(Math.abs));
  const digits = Number.isFinite(step) ? 1 + Math.max(0, Math.ceil(Math.log10(largest / step) - 1e-9)) : 4;
  return places.map(x => Math.abs(x) < step * 1e-6 ? "0" : printed(x / axis.factor, Math.min(digits, 9)));
}
