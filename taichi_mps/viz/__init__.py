"""Pictures and films of a run, and the look of charts.

Nothing is computed here that a result depends on.
Read render.py first.
"""
