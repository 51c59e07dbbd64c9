"""Values of every type, encoded by rosbags.

    golden.py SHARE SEED COUNT

A line for each type that rosbags knows itself (ROS 2 Jazzy) or can read from SHARE, the directory of
interface texts: `TYPE RIHS01_... LITTLE BIG LITTLE BIG ...`, with COUNT values, each in both byte
orders, in hexadecimal and with the encapsulation header. A type it cannot read: `TYPE ! REASON`. It has no
hashes of parts of services and actions: `TYPE - LITTLE BIG ...`.
"""
import random
import sys
from pathlib import Path

import numpy
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import TIDMAP

SHARE, SEED, COUNT = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
PARTS = {"msg": [""], "srv": ["_Request", "_Response"], "action": ["_Goal", "_Result", "_Feedback"]}
INTEGERS = {f"{sign}int{bits}": (sign, bits) for sign in ("", "u") for bits in (8, 16, 32, 64)}
INTEGERS |= {"byte": ("u", 7), "octet": ("u", 7), "char": ("u", 7)}  # rosbags: one byte, signed or not
LETTERS = "abcXYZ019 _/-~äßж☃𝄞"

# rosbags hashes the `char` of a .msg file as the `char` of IDL (13). ROS 2 makes it a `uint8`: so says
# the hash that it announces for example_interfaces/srv/AddTwoInts, which has one (see basics.rs).
TIDMAP["char"] = TIDMAP["uint8"]

store = get_typestore(Stores.ROS2_JAZZY)


def register():
    """Adds what the store has not: names here and there, and what it cannot read with the reason.

    The store knows messages alone, so that parts of services and actions go by names of messages.
    """
    names = {name: name for name in store.fielddefs}
    unreadable = {}
    for file in sorted(SHARE.glob("*/*/*")):
        package, kind = file.parts[-3], file.suffix[1:]
        if kind not in PARTS:
            continue
        for suffix, text in zip(PARTS[kind], split(file.read_text())):
            name = f"{package}/{kind}/{file.stem}{suffix}"
            inside = f"{package}/msg/{file.stem}{suffix}"
            if name in names:
                continue
            try:
                store.register(get_types_from_msg(text, inside))
                names[name] = inside
            except Exception as error:  # whatever its parser says
                unreadable[name] = str(error).splitlines()[0]
    return names, unreadable


def split(text):
    parts = [[]]
    for line in text.splitlines():
        if line.strip() == "---":
            parts.append([])
        else:
            parts[-1].append(line)
    return ["\n".join(part) + "\n" for part in parts]


def primitive(rng, name, bound):
    if name == "bool":
        return rng.random() < 0.5
    if name in INTEGERS:
        sign, bits = INTEGERS[name]
        low, high = (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        return rng.choice([low, high, 0, 1, rng.randint(low, high)])
    if name in ("float32", "float64"):
        value = rng.choice([0.0, -0.0, 1.5, rng.uniform(-1e6, 1e6), float("inf")])
        return float(numpy.float32(value)) if name == "float32" else value
    if name == "string":
        text = "".join(rng.choice(LETTERS) for _ in range(rng.choice([0, 1, 3, 4, 9])))
        while bound and len(text.encode()) > bound:
            text = text[:-1]
        return text
    raise ValueError(f"type {name}")


def value(rng, name):
    """A random message of the type."""
    fields = {}
    for field, (node, detail) in store.fielddefs[name][1]:
        if field == "structure_needs_at_least_one_member":
            fields[field] = 0
        elif node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            element, bound = detail
            count = bound if node == Nodetype.ARRAY else rng.choice([0, 1, 2, 5])
            count = min(count, bound) if bound else count
            fields[field] = several(rng, element, count)
        else:
            fields[field] = one(rng, (node, detail))
    return store.types[name](**fields)


def one(rng, description):
    node, detail = description
    return value(rng, detail) if node == Nodetype.NAME else primitive(rng, *detail)


def several(rng, element, count):
    values = [one(rng, element) for _ in range(count)]
    node, detail = element
    if node == Nodetype.NAME or detail[0] == "string":
        return values
    kinds = {"byte": "uint8", "octet": "uint8", "char": "uint8", "bool": "bool"}
    return numpy.array(values, dtype=kinds.get(detail[0], detail[0]))


def line(name, inside):
    rng = random.Random(f"{SEED} {name}")
    encoded = []
    for _ in range(COUNT):
        message = value(rng, inside)
        for little in (True, False):
            encoded.append(bytes(store.serialize_cdr(message, inside, little_endian=little)).hex())
    fingerprint = store.hash_rihs01(name) if name == inside else "-"
    return " ".join([name, fingerprint, *encoded])


def main():
    names, unreadable = register()
    packages = {path.name for path in SHARE.iterdir()}
    for name in sorted(names.keys() | unreadable.keys()):
        if name.split("/")[0] not in packages:
            continue
        if name in unreadable:
            print(name, "!", unreadable[name])
            continue
        try:
            print(line(name, names[name]))
        except KeyError as error:
            print(name, "! unknown:", error)


main()
