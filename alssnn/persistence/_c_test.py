"""Vectors of a self-test: what Python computes for random signals of a model's size."""

import numpy as np

SAMPLES = 20
NEAR = {"double": 1e-11, "float": 1e-4}  # of the range of what is compared


def vectors(export, numbers):
    """Return the constants of the self-test in C.

    Parameters
    ----------
    export : Export
        The export.
    numbers : Numbers
        Type of all numbers.

    Returns
    -------
    source : str
        Definitions of arrays, one sample per row.
    """
    plant, late, law = export.plant, export.late, export.law
    rng = np.random.default_rng(0)

    def normal(scale):
        return scale * rng.standard_normal((SAMPLES, len(scale)))

    x, du = normal(late.x_scale), normal(plant.u_scale)
    u = plant.u_offset + du
    y = late.output(x, u)
    arrays = {"x_in": x, "u_in": u, "y_out": y, "x_out": late.step(x, u)}
    near = {"near_y": y, "near_x": arrays["x_out"]}
    if export.M is not None:
        error = 0.3 * normal(plant.y_scale)
        arrays["y_in"] = y + error
        error[1::2, 0] = 0.0  # not measured
        if export.gate is not None:
            error = np.clip(error, -export.gate, export.gate)
        near["near_hat"] = arrays["hat_out"] = x + error @ export.M.T
    if law is not None:
        ns = plant.law_form.nu - plant.nu
        v = plant.v_offset + normal(plant.v_scale)
        s = x[:, :ns] if plant.feedback == "state" else y
        arrays |= {"v_in": v, "s_in": s}
        d = None
        if plant.nd:
            d = arrays["d_in"] = plant.d_offset + normal(
                plant.u_scale[list(plant.given)]
            )
        arrays["law_out"], arrays["cut_out"] = law.split(v, s, d)
        near["near_law"] = np.hstack([arrays["law_out"], v])
    if export.K_x is not None:
        with np.errstate(over="ignore", invalid="ignore"):  # a loop that diverges
            signals = _loop(export, normal)
        # as long as a sample of squares has a number
        largest = np.sqrt(np.finfo(numbers.kind).max)
        far = ~np.all(np.abs(signals["control_out"]) <= largest, axis=1)
        n = max(int(np.argmax(far)), 1) if far.any() else SAMPLES
        arrays |= {name: z[:n] for name, z in signals.items() if z.size}
        near["near_control"] = arrays["control_out"]
    lines = [numbers.array(name, values) for name, values in arrays.items()]
    if export.K_x is not None:
        lines.append(f"#define CONTROLLED {n} /* samples of a closed loop */")
    for name, values in near.items():
        size = NEAR[numbers.dtype] * max(np.abs(values).max(), 1e-30)
        lines.append(f"static const real {name} = {numbers.literal(name, size)};")
    return "\n".join(lines).replace("static const real", "static const plant_real")


def _loop(export, normal):
    """Return the signals of a closed loop: what comes to the controller, and its u."""
    plant, late, controller = export.plant, export.late, export.controller()
    rest, scale = plant.v_offset, plant.v_scale
    if export.integrates:
        rest, scale = plant.y_offset, plant.y_scale
    R, noise = rest + 0.3 * normal(scale), 0.1 * normal(plant.y_scale)
    D = plant.d_offset + 0.3 * normal(plant.u_scale[list(plant.given)])
    x, Y, U = np.zeros(late.nx), noise.copy(), np.zeros((SAMPLES, plant.nv))
    for k in range(SAMPLES):
        Y[k] += late.output(x)
        y = np.where(k % 2 * (np.arange(plant.ny) == 0), np.nan, Y[k])
        U[k] = controller.step(R[k], y, d=D[k] if plant.nd else None)
        x = late.step(x, late.every_input(U[k], D[k]))
    return {"r_loop": R, "y_loop": Y, "d_loop": D, "control_out": U}
