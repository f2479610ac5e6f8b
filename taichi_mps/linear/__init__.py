"""A x = b: conjugate gradients, sparse rows, multigrid on cells and on nodes.

No physics: an operator is anything with apply().
Read pcg.py first.
"""
