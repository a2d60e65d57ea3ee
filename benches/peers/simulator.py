"""The simulator of loadmodeld through its C interface: one objective for every method.

Two forms of the same problem: `reduced` (3 unknowns ln alpha, ln nu, kappa; the linear coefficients
at their constrained optimum) and `paper` (the nine parameters (11) in the box (14)).
"""

import ctypes
import os
from pathlib import Path

import numpy

HERE = Path(__file__).resolve().parent
POINTER = ctypes.POINTER(ctypes.c_double)


def library():
    """The compiled simulator; LOADMODELD_SIMULATOR names another file."""
    name = os.environ.get("LOADMODELD_SIMULATOR")
    path = Path(name) if name else HERE / "simulator/target/release/libloadmodeld_simulator.so"
    found = ctypes.CDLL(str(path))
    handle, number = ctypes.c_void_p, ctypes.c_uint64
    found.simulator_open.restype = handle
    found.simulator_open.argtypes = [number, number]
    found.simulator_close.restype = None
    found.simulator_close.argtypes = [handle]
    found.simulator_residual_count.restype = number
    found.simulator_residual_count.argtypes = [handle]
    found.simulator_bounds.restype = None
    found.simulator_bounds.argtypes = [number, POINTER, POINTER]
    for value in (found.simulator_reduced_value, found.simulator_paper_value):
        value.restype = ctypes.c_double
        value.argtypes = [handle, POINTER]
    found.simulator_reduced_expansion.restype = ctypes.c_double
    found.simulator_reduced_expansion.argtypes = [handle, POINTER, POINTER, POINTER]
    for residuals in (found.simulator_reduced_residuals, found.simulator_paper_residuals):
        residuals.restype = ctypes.c_int32
        residuals.argtypes = [handle, POINTER, POINTER, POINTER]
    found.simulator_fit.restype = ctypes.c_double
    found.simulator_fit.argtypes = [handle, POINTER, POINTER]
    return found


def array(values):
    """A contiguous array of doubles and its address."""
    values = numpy.ascontiguousarray(values, dtype=float)
    return values, values.ctypes.data_as(POINTER)


class Problem:
    """Problem `index` of `seed`."""

    def __init__(self, simulator, seed, index):
        self.simulator = simulator
        self.handle = simulator.simulator_open(seed, index)
        self.residual_count = simulator.simulator_residual_count(self.handle)

    def close(self):
        self.simulator.simulator_close(self.handle)
        self.handle = None

    def form(self, name):
        return Reduced(self) if name == "reduced" else Paper(self)

    def fit(self):
        """The program's own fit: objective, point, (simulations, with sensitivities, CPU s, solutions)."""
        x, x_at = array(numpy.zeros(3))
        cost, cost_at = array(numpy.zeros(4))
        value = self.simulator.simulator_fit(self.handle, x_at, cost_at)
        return value, x, cost


class Form:
    """Objective in the unknowns a method sees."""

    def __init__(self, problem, unknowns):
        self.simulator = problem.simulator
        self.handle = problem.handle
        self.unknowns = unknowns
        self.residual_count = problem.residual_count
        lower, lower_at = array(numpy.zeros(unknowns))
        upper, upper_at = array(numpy.zeros(unknowns))
        self.simulator.simulator_bounds(unknowns, lower_at, upper_at)
        self.lower, self.upper = lower, upper


class Reduced(Form):
    def __init__(self, problem):
        super().__init__(problem, 3)

    def value(self, x):
        _, at = array(x)
        return self.simulator.simulator_reduced_value(self.handle, at)

    def expansion(self, x):
        """Value, gradient, Gauss-Newton curvature."""
        _, at = array(x)
        gradient, gradient_at = array(numpy.zeros(3))
        curvature, curvature_at = array(numpy.zeros((3, 3)))
        value = self.simulator.simulator_reduced_expansion(
            self.handle, at, gradient_at, curvature_at
        )
        return value, gradient, curvature

    def residuals(self, x):
        """Residuals and Jacobian, or none."""
        _, at = array(x)
        residuals, residuals_at = array(numpy.zeros(self.residual_count))
        jacobian, jacobian_at = array(numpy.zeros((self.residual_count, 3)))
        code = self.simulator.simulator_reduced_residuals(
            self.handle, at, residuals_at, jacobian_at
        )
        return None if code else (residuals, jacobian)


class Paper(Form):
    """The four motor parameters as logarithms, the five shares as they are."""

    LOGARITHMIC = slice(0, 4)

    def __init__(self, problem):
        super().__init__(problem, 9)
        self.lower[self.LOGARITHMIC] = numpy.log(self.lower[self.LOGARITHMIC])
        self.upper[self.LOGARITHMIC] = numpy.log(self.upper[self.LOGARITHMIC])

    def parameters(self, x):
        theta = numpy.array(x, dtype=float)
        theta[self.LOGARITHMIC] = numpy.exp(theta[self.LOGARITHMIC])
        return theta

    def value(self, x):
        _, at = array(self.parameters(x))
        return self.simulator.simulator_paper_value(self.handle, at)

    def residuals(self, x):
        theta = self.parameters(x)
        _, at = array(theta)
        residuals, residuals_at = array(numpy.zeros(self.residual_count))
        jacobian, jacobian_at = array(numpy.zeros((self.residual_count, 9)))
        code = self.simulator.simulator_paper_residuals(
            self.handle, at, residuals_at, jacobian_at
        )
        if code:
            return None
        jacobian[:, self.LOGARITHMIC] *= theta[self.LOGARITHMIC]
        return residuals, jacobian

    def expansion(self, x):
        found = self.residuals(x)
        if found is None:
            return float("inf"), numpy.zeros(9), numpy.zeros((9, 9))
        residuals, jacobian = found
        return (
            0.5 * float(residuals @ residuals),
            jacobian.T @ residuals,
            jacobian.T @ jacobian,
        )
