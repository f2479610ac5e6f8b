"""Time schemes: each owns its whole step, a table of contents over the terms.

No files, no stopping rule, no schedule.
Read implicit.py first.
"""
