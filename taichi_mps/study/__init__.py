"""Many runs of a scene: sweeps, their results, calibration, and where they are computed.

No terminal: what is typed and shown is cli/.
Read sweep.py first.
"""
