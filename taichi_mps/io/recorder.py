"""Recorder of a run in progress: history, trajectory, checkpoints, summary."""

import time
from datetime import datetime

import numpy as np

from . import checkpoint
from .history import History, history_row, read_history
from .run_folder import RunFolder, strict
from .summary import summary
from .vtkhdf import Trajectory, is_output_time

CHECKPOINT_COST = 0.02  # fraction of the time that a run takes, spent on checkpoints


class Recorder:
    """Records a run in progress: history every step, an output in run.h5 every ``every`` [s], a checkpoint at the start
    and then so often that it costs at most CHECKPOINT_COST of the time.

    ``settings``: options of the run that ``resume`` needs; ``notify()`` is called after each output.
    """

    def __init__(self, folder: RunFolder, sim, every: float, source: str, settings: dict, notify=lambda: None):
        self.folder, self.sim, self.source, self.settings, self.every = folder, sim, source, settings, every
        self.notify = notify
        self.trajectory = Trajectory(folder.trajectory)
        self.measures = sim.measures()  # of the last step
        resumed = sim.steps > 0 and folder.trajectory.is_file()
        folder.check_pictures()
        self.history = History(folder.history, kept=sim.time if sim.steps > 0 else None)
        if resumed:
            if sim.time < sim.scene.until - 1e-9:  # a finished run keeps its last output
                outputs = self.trajectory.cut(sim.time, every)
                for extra in folder.pictures:
                    if int(extra.stem.removeprefix("frame_")) >= outputs:
                        extra.unlink()
        else:
            self.trajectory.create(sim, source, every)
        if self.history.empty:
            self.history.add(history_row(sim, self.measures))
        self.first_step, self.next_checkpoint = sim.steps, time.monotonic()
        if resumed:
            self.last_checkpoint = self._checkpoint()
        else:
            self._save()
        sim.each_step(self.record_step)
        sim.every(every, self.record_output)

    def _checkpoint(self):
        return checkpoint.Checkpoint.of(self.sim, self.source, self.settings)

    def _save(self):
        begin = time.monotonic()
        self.last_checkpoint = self._checkpoint()
        self.last_checkpoint.write(self.folder.checkpoint)
        now = time.monotonic()
        self.next_checkpoint = now + (now - begin) / CHECKPOINT_COST

    def record_step(self, sim) -> None:
        """Write a row of history.csv after a step, and a checkpoint if one is due; skipped after a step that left
        particles out, since reading the fields would bring them back."""
        if sim.all_active:
            self.measures = sim.measures()
            self.history.add(history_row(sim, self.measures))
            if time.monotonic() > self.next_checkpoint:
                self._save()

    def record_output(self, frame) -> None:
        """Write a frame into run.h5."""
        if self.sim.steps == self.first_step and not is_output_time(frame.time, self.every):
            return  # a run resumed between two outputs has no output at its start
        if self.trajectory.append(frame.snapshot()) is not None:
            self.last_checkpoint = self._checkpoint()
            self.notify()

    def finish(self, stopped_by: str, error: str | None = None) -> dict:
        """Write the checkpoint (after a divergence the last good one) and the summary, and return the summary."""
        (self.last_checkpoint if error else self._checkpoint()).write(self.folder.checkpoint)
        self.trajectory.close()
        facts = {
            **summary(self.sim),
            "stopped_by": stopped_by,
            "resume_from": str(self.folder.checkpoint),
            "ended": datetime.now().astimezone().isoformat(timespec="seconds"),
            **{key: self.settings[key] for key in ("title", "note") if self.settings.get(key)},
            **({"error": error} if error else {}),
        }
        self.history.close()
        unknown = [key for key, value in self.measures.items() if not np.isfinite(value)]
        if unknown and self.sim.steps == self.first_step:  # loads belong to a step: to the last one before
            rows = read_history(self.folder.history)
            facts |= {key: float(rows[key][-1]) for key in unknown if np.isfinite(rows[key][-1])}
        if self.sim.scene.over_time:
            facts |= self.sim.scene.over_time(read_history(self.folder.history))
        self.folder.write_summary(facts)
        return strict(facts)
