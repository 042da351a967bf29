"""The linear system of a Newton step, solved from tip to base: the backward sweep of a linear-quadratic control
problem.

The section at node j moves by seven numbers s = (displacement, rotation, roll); the link's three unknowns u = (bend x,
bend y, twist) carry that motion on to node j + 1. The sweep keeps the quadratic energy of everything beyond a node, P
and p, and eliminates one link after the other: a block LDL' factorisation in which every pivot is 3 x 3. Two
right-hand sides are carried: the energy's gradient and the tendon's path, which a rank-one correction needs. Rotations
are composed to second order, so that the sweep is exact Newton but for terms of the order of one link's bend.
"""

from __future__ import annotations

import math

from evergym.jit import njit
from evergym.state import Array, Workspace

__all__ = ["sweep_back"]

PIVOT_MIN = 1e-9
"""Smallest pivot, as a share of the link's stiffness; a smaller one is raised (no convexity there)."""


@njit
def _factor(quu: Array, scale: float) -> tuple[float, float, float, float, float, float]:
    """Return the Cholesky factor's six entries of a symmetric 3 x 3 matrix, shifted until its pivots are positive."""
    shift = 0.0
    floor = PIVOT_MIN * scale
    while True:
        d0 = quu[0, 0] + shift
        if d0 > floor:
            l00 = math.sqrt(d0)
            l10 = quu[1, 0] / l00
            l20 = quu[2, 0] / l00
            d1 = quu[1, 1] + shift - l10 * l10
            if d1 > floor:
                l11 = math.sqrt(d1)
                l21 = (quu[2, 1] - l20 * l10) / l11
                d2 = quu[2, 2] + shift - l20 * l20 - l21 * l21
                if d2 > floor:
                    return l00, l10, l11, l20, l21, math.sqrt(d2)
        if not math.isfinite(shift) or not math.isfinite(d0):
            return math.nan, 0.0, math.nan, 0.0, 0.0, math.nan
        shift = max(4.0 * shift, 1e-2 * scale)


@njit
def _solve(
    l00: float, l10: float, l11: float, l20: float, l21: float, l22: float, b0: float, b1: float, b2: float
) -> tuple[float, float, float]:
    y0 = b0 / l00
    y1 = (b1 - l10 * y0) / l11
    y2 = (b2 - l20 * y0 - l21 * y1) / l22
    x2 = y2 / l22
    x1 = (y1 - l21 * x2) / l11
    x0 = (y0 - l10 * x1 - l20 * x2) / l00
    return x0, x1, x2


@njit
def sweep_back(n: int, ws: Workspace, damping: float) -> tuple[float, float, float]:
    """Overwrite the gains and steps of all links from the derivatives in the workspace.

    Args:
        n: Links in use.
        ws: `Workspace`; reads links, nodes and tendon, overwrites ``gain`` and ``feed_forward``.
        damping: Levenberg's: every pivot is raised by this share of its link's stiffness; 0 for Newton's step.

    Returns:
        g H^-1 g, g H^-1 t and t H^-1 t, with g the gradient and t the tendon's path derivative.
    """
    p = ws.value
    g = ws.value_gradient
    t = ws.value_tendon
    pb = ws.value_column
    quu = ws.pivot
    qus = ws.coupling
    for a in range(7):
        g[a] = ws.node_gradient[n, a] if a < 6 else 0.0
        t[a] = 0.0
        for b in range(7):
            p[a, b] = ws.node_hessian[n, a, b] if a < 6 and b < 6 else 0.0
    gg = gt = tt = 0.0
    for j in range(n - 1, -1, -1):
        rx = ws.link[j, 0]
        ry = ws.link[j, 1]
        rz = ws.link[j, 2]
        n0 = g[0]
        n1 = g[1]
        n2 = g[2]
        m0 = g[3]
        m1 = g[4]
        m2 = g[5]
        along = n0 * rx + n1 * ry + n2 * rz
        hessian = ws.link_hessian[j]
        # P times the two columns of bending: displacement zeta x r, rotation eta.
        for k in range(2):
            z0 = ws.half_column[j, k, 0]
            z1 = ws.half_column[j, k, 1]
            z2 = ws.half_column[j, k, 2]
            c0 = z1 * rz - z2 * ry
            c1 = z2 * rx - z0 * rz
            c2 = z0 * ry - z1 * rx
            e0 = ws.column[j, k, 0]
            e1 = ws.column[j, k, 1]
            e2 = ws.column[j, k, 2]
            for a in range(7):
                pb[k, a] = p[a, 0] * c0 + p[a, 1] * c1 + p[a, 2] * c2 + p[a, 3] * e0 + p[a, 4] * e1 + p[a, 5] * e2
            ws.step_column[k, 0] = c0
            ws.step_column[k, 1] = c1
            ws.step_column[k, 2] = c2
            ws.step_column[k, 3] = e0
            ws.step_column[k, 4] = e1
            ws.step_column[k, 5] = e2
        for k in range(2):
            z0 = ws.half_column[j, k, 0]
            z1 = ws.half_column[j, k, 1]
            z2 = ws.half_column[j, k, 2]
            zn = z0 * n0 + z1 * n1 + z2 * n2
            zr = z0 * rx + z1 * ry + z2 * rz
            for i in range(k + 1):
                y0 = ws.half_column[j, i, 0]
                y1 = ws.half_column[j, i, 1]
                y2 = ws.half_column[j, i, 2]
                q = hessian[i, k]
                for a in range(6):
                    q += ws.step_column[i, a] * pb[k, a]
                q += 0.5 * (zn * (y0 * rx + y1 * ry + y2 * rz) + zr * (y0 * n0 + y1 * n1 + y2 * n2))
                q -= along * (z0 * y0 + z1 * y1 + z2 * y2)
                quu[i, k] = q
                quu[k, i] = q
            q = hessian[k, 2] + pb[k, 6]
            quu[k, 2] = q
            quu[2, k] = q
            # Coupling of the bend with the motion of the first section, geometric terms included.
            e0 = ws.column[j, k, 0]
            e1 = ws.column[j, k, 1]
            e2 = ws.column[j, k, 2]
            qus[k, 0] = pb[k, 0]
            qus[k, 1] = pb[k, 1]
            qus[k, 2] = pb[k, 2]
            qus[k, 3] = pb[k, 3] + ry * pb[k, 2] - rz * pb[k, 1] + rx * zn - along * z0 + 0.5 * (e1 * m2 - e2 * m1)
            qus[k, 4] = pb[k, 4] + rz * pb[k, 0] - rx * pb[k, 2] + ry * zn - along * z1 + 0.5 * (e2 * m0 - e0 * m2)
            qus[k, 5] = pb[k, 5] + rx * pb[k, 1] - ry * pb[k, 0] + rz * zn - along * z2 + 0.5 * (e0 * m1 - e1 * m0)
            qus[k, 6] = pb[k, 6] + hessian[k, 3]
        quu[2, 2] = hessian[2, 2] + p[6, 6]
        qus[2, 0] = p[0, 6]
        qus[2, 1] = p[1, 6]
        qus[2, 2] = p[2, 6]
        qus[2, 3] = p[3, 6] + ry * p[2, 6] - rz * p[1, 6]
        qus[2, 4] = p[4, 6] + rz * p[0, 6] - rx * p[2, 6]
        qus[2, 5] = p[5, 6] + rx * p[1, 6] - ry * p[0, 6]
        qus[2, 6] = p[6, 6] + hessian[2, 3]
        # Move P, and both gradients, from node j + 1 to node j (displacement there: that here plus rotation x r).
        for a in range(7):
            p[a, 3] += ry * p[a, 2] - rz * p[a, 1]
            p[a, 4] += rz * p[a, 0] - rx * p[a, 2]
            p[a, 5] += rx * p[a, 1] - ry * p[a, 0]
        for a in range(7):
            p[3, a] += ry * p[2, a] - rz * p[1, a]
            p[4, a] += rz * p[0, a] - rx * p[2, a]
            p[5, a] += rx * p[1, a] - ry * p[0, a]
        p[3, 3] += n0 * rx - along
        p[4, 4] += n1 * ry - along
        p[5, 5] += n2 * rz - along
        half = 0.5 * (n0 * ry + n1 * rx)
        p[3, 4] += half
        p[4, 3] += half
        half = 0.5 * (n0 * rz + n2 * rx)
        p[3, 5] += half
        p[5, 3] += half
        half = 0.5 * (n1 * rz + n2 * ry)
        p[4, 5] += half
        p[5, 4] += half
        p[6, 6] += hessian[3, 3]
        u0 = ws.link_gradient[j, 0]
        u1 = ws.link_gradient[j, 1]
        v0 = ws.tendon[j, 0]
        v1 = ws.tendon[j, 1]
        for a in range(6):
            u0 += ws.step_column[0, a] * g[a]
            u1 += ws.step_column[1, a] * g[a]
            v0 += ws.step_column[0, a] * t[a]
            v1 += ws.step_column[1, a] * t[a]
        u2 = ws.link_gradient[j, 2] + g[6]
        v2 = ws.tendon[j, 2] + t[6]
        g[3] += ry * g[2] - rz * g[1]
        g[4] += rz * g[0] - rx * g[2]
        g[5] += rx * g[1] - ry * g[0]
        g[6] += ws.link_gradient[j, 3]
        t[3] += ry * t[2] - rz * t[1]
        t[4] += rz * t[0] - rx * t[2]
        t[5] += rx * t[1] - ry * t[0]
        t[6] += ws.tendon[j, 3]
        scale = max(hessian[0, 0], hessian[1, 1], hessian[2, 2])
        if damping > 0.0:
            for a in range(3):
                quu[a, a] += damping * scale
        l00, l10, l11, l20, l21, l22 = _factor(quu, scale)
        w0, w1, w2 = _solve(l00, l10, l11, l20, l21, l22, u0, u1, u2)
        ws.feed_forward[j, 0, 0] = -w0
        ws.feed_forward[j, 0, 1] = -w1
        ws.feed_forward[j, 0, 2] = -w2
        y0, y1, y2 = _solve(l00, l10, l11, l20, l21, l22, v0, v1, v2)
        ws.feed_forward[j, 1, 0] = -y0
        ws.feed_forward[j, 1, 1] = -y1
        ws.feed_forward[j, 1, 2] = -y2
        gg += u0 * w0 + u1 * w1 + u2 * w2
        gt += u0 * y0 + u1 * y1 + u2 * y2
        tt += v0 * y0 + v1 * y1 + v2 * y2
        gain = ws.gain[j]
        for a in range(7):
            k0, k1, k2 = _solve(l00, l10, l11, l20, l21, l22, qus[0, a], qus[1, a], qus[2, a])
            gain[0, a] = -k0
            gain[1, a] = -k1
            gain[2, a] = -k2
        for a in range(7):
            g[a] += gain[0, a] * u0 + gain[1, a] * u1 + gain[2, a] * u2
            t[a] += gain[0, a] * v0 + gain[1, a] * v1 + gain[2, a] * v2
            for b in range(7):
                p[a, b] += qus[0, a] * gain[0, b] + qus[1, a] * gain[1, b] + qus[2, a] * gain[2, b]
        if j > 0:
            for a in range(6):
                g[a] += ws.node_gradient[j, a]
            for a in range(3):
                for b in range(3):
                    p[a, b] += ws.node_hessian[j, a, b]
    return gg, gt, tt
