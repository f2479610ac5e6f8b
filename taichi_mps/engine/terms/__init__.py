"""One file for each physical term of the equations, and the constants of the mixes that they share.

Terms do not import each other, but for rheology and constants; each writes only its own fields.
Read stress.py first.
"""
