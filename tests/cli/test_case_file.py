"""A case file is equivalent to a command line: the same scene, numerics and options, and the same run bit by bit."""

from zlib import crc32

import pytest

import taichi_mps as mps
from taichi_mps.cli import case_file
from taichi_mps.cli.main import main, planned
from taichi_mps.cli.run import keep_edited
from taichi_mps.io.history import read_history
from taichi_mps.io.run_folder import RunFolder

QUICK = ["--spacing=0.025", "--until=0.02", "--threads=1", "--quiet"]
OWN = '''
import taichi_mps as mps
from taichi_mps.units import Length

@mps.checked
def scene(material: mps.Bingham = mps.Bingham(yield_value=40.0), spacing: Length = 0.02) -> mps.Scene:
    """A block."""
    return mps.Scene("block", material, spacing, mps.fill(mps.Box((0, 0), (0.1, 0.1)), spacing),
                     ((-0.1, -0.1), (0.5, 0.3)), walls=(mps.Plane((0, 0), (0, 1)),), until=0.1)
'''


@pytest.mark.parametrize(
    ("scheme", "name"),
    [
        *(("implicit", name) for name in sorted(mps.catalogue.names())),
        *(("semi-implicit", name) for name in ("dam_break", "film", "slump", "still_pool")),  # what that takes
    ],
)
def test_a_new_case_stands_for_the_same_scene_numerics_and_options(tmp_path, capsys, name, scheme):
    command = [name, f"--scheme={scheme}", "--tolerance=0.0012345678901234567", "--every=0.03"]
    if "yield_value" in mps.catalogue.load(name).parameters.model_fields and scheme == "implicit":
        command.append("--yield-value=0.1kPa")
    _, options, problem = planned("run", command)
    path = tmp_path / "case.toml"
    path.write_text(case_file.case_text(name, problem, options.model_dump()), encoding="utf-8")
    _, again, same = planned("run", [str(path)])
    assert same.numerics == problem.numerics
    assert (same.scene.parameters, same.scene.until) == (problem.scene.parameters, problem.scene.until)
    assert again.model_copy(update={"until": None}) == options.model_copy(update={"until": None})
    assert planned("run", [str(path), "--every=0.04"])[1].every == 0.04, "an option beside the file counts"


@pytest.mark.long
def test_a_run_from_the_case_in_a_run_folder_is_the_same_run(tmp_path):
    one, two = (RunFolder(tmp_path / name) for name in ("one", "two"))
    assert main(["run", "film", *QUICK, "--yield-value=0.4 kPa", f"--out={one.path}"]) == 0
    assert main(["run", str(one.case), "--quiet", f"--out={two.path}"]) == 0
    first, second = read_history(one.history), read_history(two.history)
    assert all(first[key].tobytes() == second[key].tobytes() for key in first)
    assert one.case.read_bytes() == two.case.read_bytes()


def test_a_case_of_a_scene_of_ones_own_names_its_file_from_where_the_case_lies(tmp_path, monkeypatch):
    (tmp_path / "block.py").write_text(OWN, encoding="utf-8")
    (tmp_path / "case.toml").write_text('scene = "block.py"\n[mix]\nyield_value = 60\n', encoding="utf-8")
    monkeypatch.chdir("/")
    assert planned("run", [str(tmp_path / "case.toml")])[2].scene.parameters["yield_value"] == 60.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "scene is missing; must be one of dam_break"),
        ("scene = 'slumb'", "unknown scene 'slumb', did you mean 'slump'?"),
        ("scene = 'slump'\n[mix]\nyeild_value = 3", "unknown key 'yeild_value', did you mean 'yield_value'?"),
        ("scene = 'slump'\n[mixx]\nyield_value = 3", "unknown section 'mixx', did you mean 'mix'?"),
        ("scene = 'slump'\nyield_value = 3", "unknown section 'yield_value'"),
        ("scene = 'slump'\n[mix]\nyield_value = 3\n[test]\nyield_value = 4", "yield_value is given twice"),
        (
            "scene = 'slump'\n[mix]\nyield_value = 3\nyield_stress = 4",
            "yield_stress is given twice, also as yield_value",
        ),
        ("scene = 'slump'\n[[mix]]\nyield_value = 3", r"must be one section, .mix."),
        ("scene = 3", "scene = 3; must be one of dam_break"),
        ("scene = 'slump'\n[mix]\nyield_value = [3, 4]", "yield_value = .3, 4.: must be a number or a text"),
        ("scene = 'slump'\n[mix]\nyield_value = true", "yield_value = true: must be no switch"),
        ("scene = 'slump'\n[output]\nbeads = 1", "beads = 1: must be true or false"),
        (
            "scene = 'slump'\n[expert]\nscheme = 'semi-implicit'\nwalls = 'surfaces'",
            "'walls': the scheme implicit has it",
        ),
        ("scene = 'slump'\n[mix]\nyield_value = '5 m'", "yield_value = 5 m: must be a number in Pa"),
        ("scene = 'slump'\n[mix]\nyield_value = -5.0", "yield_value = -5 Pa: must be greater than or equal to 0 Pa"),
        ("scene = 'slump'\n[expert]\nscheme = 'newest'", "scheme = newest: must be 'implicit' or 'semi-implicit'"),
        ("scene = 'slump'\n[output]\nout = 'here'", "unknown key 'out'"),
        ("scene = = 3", "is no TOML"),
        ("scene = 'slump'\n[output]\nplots = true", "key 'plots': report.html draws .*; version 0.3.0 reads a case of"),
        (
            "scene = 'slump'\n[expert]\nrenderer = 'software'",
            "key 'renderer': .*; version 0.3.0 reads a case of version",
        ),
        (
            "scene = 'film'\n[expert]\nscheme = 'semi-implicit'\nsource = 'mixed'\ngradient = 'smallest'",
            "key 'source': the scheme semi-implicit has two forms.*; version 0.3.0 reads a case of version 0.2",
        ),
    ],
)
def test_what_is_no_case_is_refused_in_one_line(tmp_path, text, message):
    (tmp_path / "case.toml").write_text(text, encoding="utf-8")
    with pytest.raises(mps.SceneError, match=message):
        planned("run", [str(tmp_path / "case.toml")])


def test_new_prints_a_case(tmp_path, capsys):
    path = tmp_path / "case.toml"
    assert main(["new", "wall", "--rate=10 l/s"]) == 0
    path.write_text(capsys.readouterr().out, encoding="utf-8")
    assert planned("run", [str(path)])[2].scene.parameters["rate"] == 0.01


@pytest.mark.parametrize(
    ("encoding", "line"),
    [
        ("utf-16", "yield_value = 60.0"),
        ("utf-8-sig", "yield_value = 60.0"),
        ("utf-8", 'yield_stress = "0.06 kPa"'),  # the name of its option
    ],
)
def test_a_case_may_be_written_by_powershell_or_notepad_and_with_names_of_options(tmp_path, encoding, line):
    (tmp_path / "case.toml").write_text(f'scene = "slump"\r\n[mix]\r\n{line}\r\n', encoding=encoding)
    assert planned("run", [str(tmp_path / "case.toml")])[2].scene.material.yield_value == 60.0


@pytest.mark.parametrize("edit", [("", ""), ("until = 0.02 ", "until = 0.5 "), ("[mix]", "[mix")])
def test_a_case_that_was_edited_after_its_run_had_begun_is_kept_and_told(tmp_path, capsys, edit):
    """A resumed run writes the case of what it computes; an edited one stays beside it."""
    _, options, problem = planned("run", ["slump", *QUICK])
    path, text = tmp_path / "case.toml", case_file.case_text("slump", problem, options.model_dump())
    assert edit[0] in text
    path.write_bytes(text.replace(*edit).encode())
    keep_edited(path, {crc32(text.encode())})
    is_edited = any(edit)
    assert ("has been edited" in capsys.readouterr().err) is is_edited is (not path.is_file())
    kept = tmp_path / "case.edited.toml" if is_edited else path
    assert kept.read_text(encoding="utf-8") == text.replace(*edit)
