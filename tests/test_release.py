"""What .ci/release.py refuses: a wheel whose metadata, or a file beside it, lacks the address of the project."""

import runpy

import pytest

from tests.support.child import ROOT

ADDRESS = "https://example.org/flow"
METADATA = (
    f"Metadata-Version: 2.4\nVersion: 1.0.0\nProject-URL: Repository, {ADDRESS}\n\n[limits]({ADDRESS}/limits.md)\n"
)
lacking, PLACES = (runpy.run_path(str(ROOT / ".ci" / "release.py"))[name] for name in ("lacking", "PLACES"))
FILES = {file: f"at {ADDRESS}" for file in PLACES if file != "README.md"}


def test_a_release_that_holds_its_address_everywhere_is_ready():
    assert lacking(METADATA, FILES) == []


@pytest.mark.parametrize(
    "wrong, named",
    [
        ((METADATA.replace("1.0.0", "1.0.0.dev0"), FILES), "version 1.0.0.dev0: is no release"),
        ((METADATA.replace("Repository", "Documentation"), FILES), "pyproject.toml: no Repository in [project.urls]"),
        ((METADATA.replace(f"({ADDRESS}/", "("), FILES), f"README.md: {ADDRESS} is missing, {PLACES['README.md']}"),
        *(((METADATA, FILES | {file: ""}), f"{file}: {ADDRESS} is missing, {PLACES[file]}") for file in FILES),
    ],
)
def test_a_release_that_lacks_its_address_is_refused_by_the_name_of_the_place(wrong, named):
    assert lacking(*wrong) == [named]
