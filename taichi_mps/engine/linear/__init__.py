"""A x = b: conjugate gradients, sparse rows, multigrid on grids of nodes.

No physics: an operator is anything with multiply().
Read pcg.py first.
"""
