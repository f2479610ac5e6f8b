"""Time: a scheme taken from step to step, schedules, pouring, rest; the memory it takes.

No equation and no file: output happens in callbacks.
Read simulation.py first.
"""
