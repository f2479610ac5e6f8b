"""Time: a scheme taken from step to step, schedules, pouring, rest, summary.

No equation and no file: output happens in callbacks.
Read simulation.py first.
"""
