"""Many runs: sweeps, results, calibration, executors.

No terminal: that is cli/.
Read sweep.py first.
"""
