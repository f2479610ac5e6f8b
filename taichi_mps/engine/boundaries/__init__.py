"""Action of walls on particles: sums over ghosts behind the wall, friction, and what keeps particles out.

No stress law, no time step.
Read walls.py first.
"""
