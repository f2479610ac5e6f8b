"""Where things are, in plain NumPy: bodies to fill, walls, solids from a distance or a mesh, the cavity to be filled.

Nothing here knows Taichi, materials or time.
Read shapes.py first.
"""
