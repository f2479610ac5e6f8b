"""The particles: what they carry, who their neighbours are, kernels, the least-squares gradient and its adjoint.

No material, no time step.
Read particles.py first.
"""
