"""Read from shared libraries what they are made for and what they export; three formats, by hand."""

import struct


def elf(image: bytes) -> tuple[str, set[str]]:
    """Processor and exported names of an ELF library."""
    assert image[:6] == b"\x7fELF\x02\x01"
    kind, machine = struct.unpack_from("<HH", image, 16)
    assert kind == 3  # a shared library
    (table,) = struct.unpack_from("<Q", image, 40)
    size, number = struct.unpack_from("<HH", image, 58)
    sections = [struct.unpack_from("<IIQQQQIIQQ", image, table + i * size) for i in range(number)]
    symbols = next(s for s in sections if s[1] == 11)  # SHT_DYNSYM
    strings = sections[symbols[6]][4]
    names = set()
    for at in range(symbols[4], symbols[4] + symbols[5], 24):
        name, _, other, section = struct.unpack_from("<IBBH", image, at)
        if section and other & 3 == 0:
            names.add(text(image, strings + name))
    return {62: "x86_64-linux", 183: "aarch64-linux"}[machine], names


def pe(image: bytes) -> tuple[str, set[str]]:
    """Processor and exported names of a library for Windows."""
    (start,) = struct.unpack_from("<I", image, 60)
    assert image[:2] == b"MZ"
    assert image[start : start + 4] == b"PE\0\0"
    machine, n_sections = struct.unpack_from("<HH", image, start + 4)
    (n_optional,) = struct.unpack_from("<H", image, start + 20)
    magic, table = struct.unpack_from("<H110xI", image, start + 24)
    assert magic == 0x20B
    first = start + 24 + n_optional
    sections = [struct.unpack_from("<8x4I", image, first + 40 * i) for i in range(n_sections)]

    def at(address: int) -> int:
        section = next(s for s in sections if s[1] <= address < s[1] + s[0])
        return int(address - section[1] + section[3])

    number, pointers = struct.unpack_from("<I4xI", image, at(table) + 24)
    found = struct.unpack_from(f"<{number}I", image, at(pointers))
    return {0x8664: "x86_64-windows"}[machine], {text(image, at(p)) for p in found}


def mach_o(image: bytes) -> tuple[str, set[str]]:
    """Processor and exported names of a library for macOS; ARM's must be signed, if only ad hoc."""
    magic, processor, _, kind, n_commands = struct.unpack_from("<5I", image)
    assert magic == 0xFEEDFACF
    assert kind == 6  # a shared library
    commands, at = {}, 32
    for _ in range(n_commands):
        command, size = struct.unpack_from("<II", image, at)
        commands[command] = image[at : at + size]
        at += size
    assert text(commands[0xD], 24).startswith("@rpath/")  # LC_ID_DYLIB: no folder of the builder
    if 0x80000033 in commands:  # LC_DYLD_EXPORTS_TRIE
        start, size = struct.unpack_from("<II", commands[0x80000033], 8)
    else:  # LC_DYLD_INFO_ONLY
        start, size = struct.unpack_from("<II", commands[0x80000022], 40)
    names = {n.removeprefix("_") for n in trie(image[start : start + size], 0, "")}
    names -= {"__dso_handle", "_mh_dylib_header"}  # the linker's own
    assert processor == 0x1000007 or 0x1D in commands  # LC_CODE_SIGNATURE
    return {0x1000007: "x86_64-darwin", 0x100000C: "aarch64-darwin"}[processor], names


def trie(data: bytes, at: int, prefix: str) -> set[str]:
    """Names in the prefix tree of exported symbols."""

    def number(at: int) -> tuple[int, int]:
        value = shift = 0
        while True:
            value |= (data[at] & 127) << shift
            shift, at = shift + 7, at + 1
            if data[at - 1] < 128:
                return value, at

    size, at = number(at)
    names = {prefix} if size else set()
    at += size
    children, at = data[at], at + 1
    for _ in range(children):
        label = text(data, at)
        child, at = number(at + len(label) + 1)
        names |= trie(data, child, prefix + label)
    return names


def text(image: bytes, at: int) -> str:
    """The string at a place, up to its zero."""
    return image[at : image.index(0, at)].decode()


READERS = {".so": elf, ".dll": pe, ".dylib": mach_o}
