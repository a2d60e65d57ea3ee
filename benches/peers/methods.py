"""What a user would run instead of the program's search, each with the settings its manual
recommends, within a common number of evaluations. Every random choice follows from a seed."""

import logging
import time
import warnings

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # no plots here
    import cma
import fides
import nlopt
import numpy
from scipy import optimize

# What a method is told where the objective does not exist, and the size beyond which it counts as
# not existing: far above any objective of the problems.
UNDEFINED = 1e12


class Finished(Exception):
    """The evaluations are used up, or the objective is low enough."""


class Recorder:
    """Counts evaluations and notes every improvement with its cost."""

    def __init__(self, form, evaluations_max, enough):
        self.form = form
        self.evaluations_max = evaluations_max
        self.enough = enough
        self.evaluations = 0
        self.best = float("inf")
        self.point = None
        self.trace = []
        self.started = time.thread_time()

    def _note(self, x, value):
        self.evaluations += 1
        if value < self.best:
            self.best = value
            self.point = numpy.array(x, dtype=float)
            self.trace.append((self.evaluations, time.thread_time() - self.started, value))
        return value if numpy.isfinite(value) else UNDEFINED

    def _admit(self):
        if self.evaluations >= self.evaluations_max or self.best <= self.enough:
            raise Finished

    def value(self, x):
        self._admit()
        return self._note(x, self.form.value(x))

    def value_and_gradient(self, x):
        value, gradient, _ = self.expansion(x)
        return value, gradient

    def expansion(self, x):
        self._admit()
        value, gradient, curvature = self.form.expansion(x)
        value = self._note(x, value)
        if value >= UNDEFINED:
            return UNDEFINED, numpy.zeros(len(x)), numpy.eye(len(x))
        return value, gradient, curvature

    def residuals(self, x):
        """Residuals and Jacobian; constant residuals where they do not exist."""
        self._admit()
        found = self.form.residuals(x)
        if found is None:
            self._note(x, float("inf"))
            count = self.form.residual_count
            large = numpy.full(count, numpy.sqrt(2 * UNDEFINED / count))
            return large, numpy.zeros((count, self.form.unknowns))
        self._note(x, 0.5 * float(found[0] @ found[0]))
        return found

    def start(self, random):
        """A point of the box, drawn again where the objective does not exist."""
        while True:
            x = random.uniform(self.form.lower, self.form.upper)
            if self.value(x) < UNDEFINED:
                return x


def multistart(local):
    """One local solve after another from random points."""

    def run(recorder, random):
        while True:
            local(recorder, recorder.start(random))

    return run


def trust_region_reflective(recorder, start):
    """scipy.optimize.least_squares with the exact Jacobian."""
    last = {}

    def residuals(x):
        last["x"], last["found"] = x.copy(), recorder.residuals(x)
        return last["found"][0]

    def jacobian(x):
        if not numpy.array_equal(last["x"], x):
            residuals(x)
        return last["found"][1]

    bounds = (recorder.form.lower, recorder.form.upper)
    optimize.least_squares(residuals, start, jacobian, bounds=bounds, method="trf", x_scale="jac")


def quasi_newton(recorder, start):
    """scipy.optimize.minimize, L-BFGS-B with the exact gradient."""
    bounds = list(zip(recorder.form.lower, recorder.form.upper))
    optimize.minimize(
        recorder.value_and_gradient, start, jac=True, method="L-BFGS-B", bounds=bounds
    )


def fides_local(recorder, start):
    """fides, pyPESTO's optimiser, with the Gauss-Newton Hessian."""
    solver = fides.Optimizer(
        recorder.expansion,
        ub=recorder.form.upper,
        lb=recorder.form.lower,
        verbose=logging.CRITICAL,
    )
    try:
        solver.minimize(start)
    except RuntimeError:
        # A step beyond a bound by one rounding; pyPESTO goes on to the next start too.
        pass


def differential_evolution(recorder, random):
    bounds = list(zip(recorder.form.lower, recorder.form.upper))
    while True:
        optimize.differential_evolution(recorder.value, bounds, rng=random)


def covariance_matrix_adaptation(recorder, random):
    """CMA-ES in the unit box, restarted with a doubled population."""
    lower, span = recorder.form.lower, recorder.form.upper - recorder.form.lower

    def value(unit):
        return recorder.value(lower + span * numpy.asarray(unit))

    while True:
        options = {
            "bounds": [0, 1],
            "seed": int(random.integers(1, 2**31)),
            "verbose": -9,
            "maxfevals": recorder.evaluations_max,
        }
        start = (recorder.start(random) - lower) / span
        cma.fmin2(value, start, 0.3, options, restarts=9)


def multi_level_single_linkage(recorder, random):
    """NLopt's G_MLSL_LDS with SLSQP inside."""
    nlopt.srand(int(random.integers(1, 2**31)))
    unknowns = recorder.form.unknowns

    while True:
        start = recorder.start(random)
        # SLSQP's line search wants an objective of order one.
        scale = 1 / max(recorder.best, 1.0)

        def objective(x, gradient, scale=scale):
            if gradient.size == 0:
                return scale * recorder.value(x)
            value, slope = recorder.value_and_gradient(x)
            gradient[:] = scale * slope
            return scale * value

        local = nlopt.opt(nlopt.LD_SLSQP, unknowns)
        local.set_xtol_rel(1e-6)
        local.set_ftol_rel(1e-9)
        solver = nlopt.opt(nlopt.G_MLSL_LDS, unknowns)
        solver.set_local_optimizer(local)
        solver.set_lower_bounds(recorder.form.lower)
        solver.set_upper_bounds(recorder.form.upper)
        solver.set_min_objective(objective)
        solver.set_maxeval(recorder.evaluations_max)
        try:
            solver.optimize(start)
        except (RuntimeError, nlopt.runtime_error, nlopt.RoundoffLimited):
            # SLSQP gives up now and then and takes MLSL with it: begin again elsewhere.
            pass


def basin_hopping(recorder, random):
    lower, upper = recorder.form.lower, recorder.form.upper
    span = upper - lower

    def step(x):
        return numpy.clip(x + 0.5 * span * random.uniform(-1, 1, len(x)), lower, upper)

    optimize.basinhopping(
        recorder.value_and_gradient,
        recorder.start(random),
        niter=10**6,
        take_step=step,
        minimizer_kwargs={
            "jac": True,
            "method": "L-BFGS-B",
            "bounds": list(zip(lower, upper)),
        },
        rng=random,
    )


METHODS = {
    "SciPy TRF multistart": multistart(trust_region_reflective),
    "L-BFGS-B multistart": multistart(quasi_newton),
    "fides multistart": multistart(fides_local),
    "NLopt MLSL + SLSQP": multi_level_single_linkage,
    "SciPy basinhopping": basin_hopping,
    "CMA-ES": covariance_matrix_adaptation,
    "SciPy differential evolution": differential_evolution,
}


def run(name, form, evaluations_max, enough, seed):
    """The recorder of one method on one problem, and what ended it early, if anything.

    `enough` is an objective at which it may stop; minus infinity to use up its evaluations.
    """
    recorder = Recorder(form, evaluations_max, enough)
    failure = None
    with warnings.catch_warnings(), numpy.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            METHODS[name](recorder, numpy.random.default_rng(seed))
        except Finished:
            pass
        except Exception as error:  # a method's own failure is a result of the bench
            # NLopt hides the exception that stopped it.
            if recorder.evaluations < evaluations_max and recorder.best > enough:
                failure = f"{type(error).__name__}: {error}"
    return recorder, failure
