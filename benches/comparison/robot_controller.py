"""The L1 controller of example 3.3.1, case 2, as a PythonFMU unit: the classical Runge-Kutta method with SUBSTEPS equal
steps a communication step, in plain Python, which for two channels is faster than numpy."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Real

SUBSTEPS = 8
STIFFNESS, DAMPING = (900.25, 1600.25), (60.0, 80.0)
# The last row of P of each channel, from A_m' P + P A_m = -I.
P = [(1 / (2 * k), (1 + 1 / k) / (2 * d)) for k, d in zip(STIFFNESS, DAMPING, strict=True)]
ADAPTATION_GAIN, FEEDBACK_GAIN, PROJECTION_TOLERANCE = 1e5, 30.0, 0.1
# Centre and half width of the bounds of omega_hat by rows, theta_hat and sigma_hat.
BOUNDS = [(5.25, 4.75), (0.0, 2.0), (0.0, 2.0), (5.25, 4.75), (0.0, 100.0), (0.0, 100.0), (0.0, 10.0), (0.0, 10.0)]


def projected(estimate: float, rate: float, centre: float, half: float) -> float:
    d = estimate - centre
    f = ((1 + PROJECTION_TOLERANCE) * d * d - half * half) / (PROJECTION_TOLERANCE * half * half)
    return rate * (1 - f) if f > 0 and d * rate > 0 else rate


def law(r: list[float], x: list[float], z: list[float]) -> tuple[list[float], list[float]]:
    """The control, and the rates of z = (x_hat, omega_hat by rows, theta_hat, sigma_hat, u_ad)."""
    baseline = [STIFFNESS[i] * x[i] + DAMPING[i] * x[2 + i] for i in (0, 1)]
    u = [z[12] - baseline[0], z[13] - baseline[1]]
    phi = max(map(abs, x))
    eta = [z[4 + 2 * i] * u[0] + z[5 + 2 * i] * u[1] + z[8 + i] * phi + z[10 + i] + baseline[i] for i in (0, 1)]
    s = [P[i][0] * (x[i] - z[i]) + P[i][1] * (x[2 + i] - z[2 + i]) for i in (0, 1)]
    wanted = [s[0] * u[0], s[0] * u[1], s[1] * u[0], s[1] * u[1], s[0] * phi, s[1] * phi, *s]
    adapted = [ADAPTATION_GAIN * projected(v, rate, *b) for v, rate, b in zip(z[4:12], wanted, BOUNDS, strict=True)]
    predicted = [-STIFFNESS[i] * z[i] - DAMPING[i] * z[2 + i] + eta[i] for i in (0, 1)]
    return u, [z[2], z[3], *predicted, *adapted, *(-FEEDBACK_GAIN * (eta[i] - STIFFNESS[i] * r[i]) for i in (0, 1))]


class RobotController(Fmi2Slave):
    """Inputs r and x, output u."""

    def __init__(self, **arguments: object) -> None:
        super().__init__(**arguments)
        self.r, self.x, self.u, self.z = [0.0] * 2, [0.0] * 4, [0.0] * 2, None
        for name, causality in (("r", Fmi2Causality.input), ("x", Fmi2Causality.input), ("u", Fmi2Causality.output)):
            values = getattr(self, name)
            for i in range(len(values)):
                self.register_variable(
                    Real(
                        f"{name}[{i + 1}]",
                        causality=causality,
                        getter=lambda values=values, i=i: values[i],
                        setter=lambda value, values=values, i=i: values.__setitem__(i, value),
                    )
                )

    def do_step(self, _time: float, step: float) -> bool:
        if self.z is None:
            # The predictor starts at the measured state, omega_hat at the identity.
            self.z = [*self.x, 1.0, 0.0, 0.0, 1.0, *[0.0] * 6]
        r, x, z, h = self.r, self.x, self.z, step / SUBSTEPS
        for _ in range(SUBSTEPS):
            k1 = law(r, x, z)[1]
            k2 = law(r, x, [a + 0.5 * h * b for a, b in zip(z, k1, strict=True)])[1]
            k3 = law(r, x, [a + 0.5 * h * b for a, b in zip(z, k2, strict=True)])[1]
            k4 = law(r, x, [a + h * b for a, b in zip(z, k3, strict=True)])[1]
            z = [a + h / 6 * (b + 2 * (c + d) + e) for a, b, c, d, e in zip(z, k1, k2, k3, k4, strict=True)]
        self.z = z
        self.u[:] = law(r, x, z)[0]
        return True
