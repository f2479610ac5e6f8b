"""What a run will take and how good it will be, given before it: errors and cost from measured tables, closed forms of
the shape at rest, the clock.

Nothing here changes a run.
Read accuracy.py first.
"""
