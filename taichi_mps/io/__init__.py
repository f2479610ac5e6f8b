"""Files: run folder, summary, history, trajectory, checkpoints; what comes from others is read with suspicion.

No numerics.
Read run_folder.py first.
"""
