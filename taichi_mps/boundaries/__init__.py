"""What a wall does to a particle in front of it: sums over the ghosts behind it, friction, what keeps it out.

No stress law, no time step.
Read walls.py first.
"""
