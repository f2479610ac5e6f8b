"""Input that cannot be read in seconds is refused in one line that names the file: files too large, pipes, devices,
folders, a checkpoint with particles outside of any domain."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.cli import case_file
from taichi_mps.engine.geometry.meshes import read_mesh
from taichi_mps.io.history import read_history
from taichi_mps.study import case, measured_mixes, tables


def sparse(path):
    with open(path, "wb") as file:
        file.truncate(200 * 10**9)


BAD = {  # what stands where a file should: how it is made, what is said of it
    "too large": (sparse, r"has 2e\+05 MB; must have at most"),
    "a pipe": (os.mkfifo, "is a folder, a pipe or a device; must be a file"),
    "a device": (lambda path: path.symlink_to("/dev/zero"), "is a folder, a pipe or a device; must be a file"),
    "a folder": (Path.mkdir, "is a folder, a pipe or a device; must be a file"),
}
READERS = {
    "case": case_file.command_words,
    "list": measured_mixes.read_list,
    "checkpoint": mps.checkpoint.read,
    "history": read_history,
    "results": tables.read,
    "mesh": read_mesh,
}


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("name", READERS)
def test_a_file_without_end_is_refused_unread(tmp_path, name, bad):
    make, message = BAD[bad]
    path = tmp_path / "file.stl"
    make(path)
    others = "|holds no history.csv; must be the folder of a run|results.csv: no such file"
    with pytest.raises(mps.SceneError, match=message + others * (bad != "too large")) as refused:
        READERS[name](path)
    assert str(tmp_path) in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize("name", READERS)
def test_a_file_of_somebody_else_is_refused_by_that(tmp_path, monkeypatch, name):
    """Where this user must not read a file, that is said, of a mesh and a checkpoint, too."""
    path = tmp_path / "file.stl"
    path.write_text("text")
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.R_OK)
    with pytest.raises(mps.SceneError, match=r"file.stl: cannot be read \(Permission denied\)"):
        READERS[name](path)


def test_the_digest_of_a_case_reads_no_file_without_end(tmp_path):
    sparse(tmp_path / "bars.stl")
    with pytest.raises(mps.SceneError, match="bars.stl: has 2e"):
        case.case_of("wall", rebar=str(tmp_path / "bars.stl"))


def test_a_checkpoint_holds_particles_of_its_domain():
    """A checkpoint may hold a particle beyond the edge of its domain, which ends the run, but none a domain away."""
    scene = mps.catalogue.build("slump", spacing=0.05)
    x = np.array(scene.fluid)
    header = {"source": "slump", "parameters": {}, "scheme": "implicit", "numerics": {}}
    header["fluid"] = mps.checkpoint.digest(scene, mps.checkpoint.PARTICLE_ATTRIBUTES)
    x[0] = 1.5 * np.array(scene.domain[1])
    mps.checkpoint.Checkpoint(header, {"x": x}).admit(scene)
    for far in (3.0, 1e300):
        x[0, 0] = far
        with pytest.raises(
            mps.SceneError, match=r"checkpoint: a particle lies at \[.*\] m; must be in the domain, from"
        ):
            mps.checkpoint.Checkpoint(header, {"x": x}).admit(replace(scene))
