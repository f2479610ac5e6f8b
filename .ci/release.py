"""Refuses what is not ready for an index: python .ci/release.py dist/*.whl

The address of the project stands in one place, `Repository` in [project.urls] of pyproject.toml. What else must
hold it, and does not, is named here; ends with 1 if there is any.
"""

import sys
from email import message_from_string
from pathlib import Path
from zipfile import ZipFile

ROOT = Path(__file__).resolve().parents[1]
PLACES = {  # file that must hold the address: what for
    "README.md": "its links on an index: last substitutions of README.md in pyproject.toml",
    "CITATION.cff": "repository-code",
    "docs/install.md": "where to send what a machine printed",
}


def lacking(metadata: str, texts: dict[str, str]) -> list[str]:
    """What a release lacks, by the METADATA of its wheel and the text of each file of PLACES but README.md, which the
    metadata hold as an index shows it."""
    about = message_from_string(metadata)
    urls = dict(each.split(", ", 1) for each in about.get_all("Project-URL", []))
    found = [f"version {about['Version']}: is no release"] * ("dev" in about["Version"])
    address = urls.get("Repository")
    if not address:
        return [*found, "pyproject.toml: no Repository in [project.urls]"]
    texts = texts | {"README.md": about.get_payload()}
    return found + [
        f"{file}: {address} is missing, {what}" for file, what in PLACES.items() if address not in texts[file]
    ]


def main(wheel: str) -> int:
    with ZipFile(wheel) as held:
        name = next(name for name in held.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = held.read(name).decode()
    found = lacking(metadata, {file: (ROOT / file).read_text(encoding="utf-8") for file in PLACES})
    print("\n".join(found) or f"{Path(wheel).name}: ready")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
