"""The machine: its memory, and all that is Taichi's own: start, kernels and how they are launched, threads, fields in
and out, workarounds.

No physics, no scene.
Read backend.py first.
"""
