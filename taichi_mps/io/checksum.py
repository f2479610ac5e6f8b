"""Checksums of what a run folder stores: whatever changes afterwards is noticed where it is read, and never shown."""

import json
import zlib

import numpy as np


def crc32(*parts) -> int:
    """CRC-32 of texts and arrays one after the other; of arrays their shapes and values, however they are stored."""
    total = 0
    for part in parts:
        if not isinstance(part, str):
            array = np.ascontiguousarray(part, "<f8")
            total = zlib.crc32(str(array.shape).encode(), total)
            part = array.data if array.size else b""
        total = zlib.crc32(part.encode("utf-8", "surrogatepass") if isinstance(part, str) else part, total)
    return total


def of_facts(facts: dict) -> str:
    """Checksum of a JSON object."""
    return f"{crc32(json.dumps(facts, sort_keys=True)):08x}"


def of_outputs(file) -> int:
    """Checksum of what all outputs of a run.h5 share."""
    root, own = file["VTKHDF"], file["taichi_mps"]
    texts = [str(own.attrs[name]) for name in ("source", "parameters", "dimension", "every")]
    arrays = [root["NumberOfPoints"][()], own["wall_x"][()], own["mouth"][()] if "mouth" in own else ()]
    return crc32(*texts, *sorted(root["PointData"]), *arrays)


def of_output(time: float, points, data: dict) -> int:
    """Checksum of one output: its time [s], points (n, 3) [m] and fields by name."""
    return crc32([time], points, *(part for name in sorted(data) for part in (name, data[name])))
