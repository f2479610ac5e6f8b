"""What is to be computed: scene, materials, inlets, measures, numerics, and the rules that a problem must obey.

Nothing here knows Taichi; what passed these rules is not checked again.
Read problem.py first.
"""
