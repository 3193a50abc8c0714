"""What the campaigns of the tests have in common: flight noise, nominal authority, one experiment."""

ONE_EXPERIMENT = """\
[noise]
oms = "35 fm Hz^-0.5"
thruster = "0.15 uN Hz^-0.5"
plateau = "5.6 fm s^-2 Hz^-0.5"
tail = 1.5

[authority.A]
F_max_1 = "0 pN"
F_max_2 = "2200 pN"
N_max_1 = "10.4 pN m"
N_max_2 = "10.4 pN m"

[[experiments]]
name = "one"
authority = "A"
alignment_epoch = 1
"""


def sine(into: str, frequency: str, amplitude: str, cycles: int, start: str) -> str:
    """Return the table of a sine that is injected into the last experiment of a text."""
    return f"""
[[experiments.injections]]
into = "{into}"
shape = "sine"
frequency = "{frequency}"
amplitude = "{amplitude}"
cycles = {cycles}
start = "{start}"
"""


def campaign(
    keys: str, *sines: tuple[str, str, str, int, str], name: str = "one", seed: int = 1, tables: str = ""
) -> str:
    """Return a campaign of one experiment: its keys, the sines injected into it, tables before it."""
    head = f'schema = "lpf-campaign/2"\nname = "{name}"\nseed = {seed}\n\n{tables}\n'
    return f"{head}{ONE_EXPERIMENT}{keys}\n" + "".join(sine(*arguments) for arguments in sines)


#: A campaign of one short experiment and its noise run.
SHORT_PLAN = campaign(
    'duration = "200 s"\nnoise_duration = "100 s"',
    ("guidance_o_1", "50 mHz", "1 nm", 5, "10 s"),
    name="short",
    seed=7,
)
