"""Constitutive laws: apparent viscosity of the bi-viscosity Bingham law, and the true yield law (eqs 1-3, 5, 9)."""

from ..runtime.backend import is_for_kernels, ti


@ti.func
def magnitude(T):
    """|T| = sqrt(T:T/2) of a deviatoric tensor: the shear stress [Pa] that is compared with the yield stress."""
    return ti.sqrt(0.5 * (T * T).sum())


@ti.func
def shear_rate(G):
    """sqrt(2 D:D) [1/s] of the deviatoric part of D = (G + G^T)/2."""
    return 2.0 * magnitude(deviator(G))


@ti.func
def deviator(G):
    """D - tr(D)/d I [1/s] of a velocity gradient G; d its size (plane strain in 2-D)."""
    return 0.5 * (G + G.transpose()) - (G.trace() / G.n) * ti.Matrix.identity(float, G.n)


def apparent_viscosity(rate, plastic_viscosity, yield_value, critical_strain_rate, maximum=max):
    """mu = eta + tau_y / max(shear rate, 2 pi_c) [Pa s] (eqs 5, 9 with Pi_c = (2 pi_c)^2, eq 3); ``maximum`` may be
    numpy.maximum for arrays. Below 2 pi_c the material counts as unyielded."""
    return plastic_viscosity + yield_value / maximum(rate, 2.0 * critical_strain_rate)


@ti.func
def bi_viscosity(rate, plastic_viscosity, yield_value, critical_strain_rate):
    """The same inside a kernel; a Newtonian mix at rest has neither a yield stress nor a rate."""
    return plastic_viscosity + yield_value / ti.max(rate, 2.0 * critical_strain_rate, 1e-12)


def flow_curve(material):
    """Shear stress [Pa] of a material at (shear rate [1/s], structure [-]) as a Taichi function; None for Bingham."""
    function = getattr(material, "shear_stress", None)
    if hasattr(material, "flow_index"):
        tau_y, k, n = material.yield_value, material.consistency, material.flow_index

        def function(rate, structure):
            return tau_y + k * ti.max(rate, 1e-12) ** n

        if material.growth is not None:

            def function(rate, structure):
                return (1.0 + structure) * tau_y + k * ti.max(rate, 1e-12) ** n

    return compiled(function)


def growth(material):
    """Rate of change [1/s] of the structure of a material at (shear rate [1/s], structure [-]) as a Taichi function;
    None for what is not thixotropic."""
    return compiled(getattr(material, "growth", None))


def compiled(function):
    """A plain Python function made a Taichi function; None, or what is one already, as it is."""
    return function if function is None or is_for_kernels(function) else ti.func(function)


@ti.func
def curve_mapping(curve: ti.template(), trial, structure, mu_r):
    """``return_mapping`` for any flow curve tau: the rate with tau(rate) + mu_r rate = |trial|, by the Illinois method.

    Rigid where |trial| <= tau(0). The root is unique, since tau does not fall, and below (|trial| - tau(0))/mu_r.
    """
    size = magnitude(trial)
    rest = ti.cast(curve(0.0, structure), float)
    low, high = ti.cast(0.0, float), ti.max(0.0, (size - rest) / mu_r)
    rate = ti.cast(0.0, float)
    if size > rest:
        below, above = rest - size, ti.cast(curve(high, structure), float) + mu_r * high - size
        side = 0
        rate = high
        for _ in range(30):
            if ti.abs(high - low) > 1e-6 * high and above > below:
                rate = (low * above - high * below) / (above - below)
                value = ti.cast(curve(rate, structure), float) + mu_r * rate - size
                if value > 0.0:
                    high, above = rate, value
                    below = ti.select(side == 1, 0.5 * below, below)
                    side = 1
                else:
                    low, below = rate, value
                    above = ti.select(side == -1, 0.5 * above, above)
                    side = -1
    factor = (size - mu_r * rate) / ti.max(size, 1e-12) if rate > 0.0 else 1.0
    stress = trial * factor
    return stress, (trial - stress) / (2.0 * mu_r), rate


@ti.func
def series_mapping(law: ti.template(), i, trial, across, mu_r, share, others):
    """``return_mapping`` of particle i next to another mix (I27), for any flow curves: the rate g of its own mix with
    tau(g) = |T|, where T is the trial over 1 + mu_r phi, its shear ``across`` over 1 + mu_r [(1 - c) phi + psi].

    phi = g/tau(g), c is the ``share`` of the other mixes, psi their fluidity ``others`` [1/(Pa s)]. |T| - tau(g) falls
    with g, below 0 at (|trial| - tau(0))/((1 - c) mu_r): the root is unique, and found by the Illinois method.
    """
    along, through = magnitude(trial - across), magnitude(across)
    rest = law.shear_stress(i, 0.0)
    low, high = ti.cast(0.0, float), ti.max(0.0, (magnitude(trial) - rest) / ((1.0 - share) * mu_r))
    size = ti.sqrt(along**2 + (through / (1.0 + mu_r * others)) ** 2)
    rate = ti.cast(0.0, float)
    if size > rest:
        below, above = rest - size, ti.cast(0.0, float)
        side = 0
        rate = high
        for turn in range(31):
            if turn == 0 or (ti.abs(high - low) > 1e-6 * high and above > below):
                if turn > 0:
                    rate = (low * above - high * below) / (above - below)
                tau = law.shear_stress(i, rate)
                phi = rate / ti.max(tau, 1e-12)
                a, b = along / (1.0 + mu_r * phi), through / (1.0 + mu_r * ((1.0 - share) * phi + others))
                value = tau - ti.sqrt(a**2 + b**2)
                if turn == 0:
                    above = value
                elif value > 0.0:
                    high, above = rate, value
                    below = ti.select(side == 1, 0.5 * below, below)
                    side = 1
                else:
                    low, below = rate, value
                    above = ti.select(side == -1, 0.5 * above, above)
                    side = -1
    phi = rate / ti.max(law.shear_stress(i, rate), 1e-12)
    ours, both = 1.0 / (1.0 + mu_r * phi), 1.0 / (1.0 + mu_r * ((1.0 - share) * phi + others))
    stress = trial * ours + across * (both - ours)
    return stress, (trial - stress) / (2.0 * mu_r), rate


@ti.func
def return_mapping(trial, plastic_viscosity, yield_value, mu_r, spread=0.0):
    """Stress [Pa] and plastic strain rate q [1/s] of a true Bingham material from the trial stress lambda + 2 mu_r D.

    Minimises the dissipation of q penalised by mu_r: |q| = max(0, (|trial| - tau_y)/(eta + mu_r)) (augmented
    Lagrangian of Fortin and Glowinski). Rigid where |trial| <= tau_y: then q = 0 and the stress is the trial.

    Where the stress differs by +-``spread`` [Pa] over what the gradient sees, the rate is the mean of the law (I31).
    """
    size = magnitude(trial)
    rate = ti.max(0.0, (size - yield_value) / (plastic_viscosity + mu_r))
    factor = (yield_value + plastic_viscosity * rate) / ti.max(size, 1e-12) if rate > 0.0 else 1.0
    over = size - yield_value + spread
    if spread > 1e-6 * yield_value and over > 0.0:
        part = 4.0 * spread * plastic_viscosity  # rate = x^2/part and x + mu_r rate = over, of x = tau - tau_y + spread
        x = 2.0 * over / (1.0 + ti.sqrt(1.0 + 4.0 * mu_r * over / part))
        if x < 2.0 * spread:
            rate = x * x / part
            factor = (size - mu_r * rate) / ti.max(size, 1e-12)
    stress = trial * factor
    return stress, (trial - stress) / (2.0 * mu_r), rate
