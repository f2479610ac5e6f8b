"""Definition of a problem: scene, materials, inlets, measures, numerics, time step, and the rules that they must obey.

Nothing here knows Taichi; what passed these rules is not checked again.
Read problem.py first.
"""
