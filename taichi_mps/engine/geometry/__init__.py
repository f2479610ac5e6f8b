"""Geometry in plain NumPy: bodies to fill, walls, solids from a distance function or a mesh, cavities.

Nothing here knows Taichi, materials or time.
Read shapes.py first.
"""
