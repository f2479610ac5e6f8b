"""Pictures, curves and films.

Nothing is computed here that a result depends on.
Read render.py first.
"""
