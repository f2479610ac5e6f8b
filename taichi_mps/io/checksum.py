"""Checksums of the texts that a run folder stores: whatever changes afterwards is noticed where it is read, and never
shown. HDF5 has its own."""

import json
import zlib

BEFORE = "written by taichi_mps before 0.1; must be read by that of commit 068d274"  # of formats no longer read


def crc32(*texts: str) -> int:
    """CRC-32 of texts one after the other."""
    return zlib.crc32("".join(texts).encode("utf-8", "surrogatepass"))


def of_facts(facts: dict) -> str:
    """Checksum of a JSON object."""
    return f"{crc32(json.dumps(facts, sort_keys=True)):08x}"
