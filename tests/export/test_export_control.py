"""The exported Functions in optimal control with do-mpc and rockit, if these are installed."""

import warnings

import casadi as cs
import numpy as np
import pytest

from ancf_casadi import Beam, Model, RayleighDamping
from ancf_casadi.export import beam_functions, values

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]

RUBBER = {"length": 0.5, "width": 0.02, "thickness": 0.02, "density": 1100.0, "elastic_modulus": 5e6, "elements": 2}


@pytest.fixture(scope="module")
def functions():
    return beam_functions(Model(Beam.uniform(**RUBBER)), RayleighDamping(alpha=0.5, beta=1e-3), modes=1)


def imported(name):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pytest.importorskip(name)


def accelerations(functions, q, v, x, x_t, x_tt):
    base = cs.vertcat(x, 0, 0, x_t, 0, 0, x_tt, 0, 0)
    return functions.rhs(q, v, base, values(functions.parameters))


def test_do_mpc_moves_the_tip(functions):
    """The model has MX symbols; the acceleration of the base is the input, and its position and velocity are states."""
    do_mpc = imported("do_mpc")
    n, start = functions.free, np.append(values(functions.states), [0.0, 0.0])
    model = do_mpc.model.Model("continuous", "MX")
    x, u = model.set_variable("_x", "x", (2 * n + 2, 1)), model.set_variable("_u", "u", (1, 1))
    q, v, position, velocity = cs.vertsplit(x, [0, n, 2 * n, 2 * n + 1, 2 * n + 2])
    model.set_rhs("x", cs.vertcat(v, accelerations(functions, q, v, position, velocity, u), velocity, u))
    model.setup()
    control = do_mpc.controller.MPC(model)
    quiet = {"ipopt.print_level": 0, "print_time": 0}
    control.set_param(n_horizon=4, t_step=0.05, store_full_solution=False, nlpsol_opts=quiet)
    miss = (model.x["x"][n - 4] - 0.1) ** 2
    control.set_objective(mterm=miss, lterm=miss)
    control.set_rterm(u=1e-4)
    control.bounds["lower", "_u", "u"], control.bounds["upper", "_u", "u"] = -5, 5
    control.setup()
    control.x0 = start
    control.set_initial_guess()
    control.make_step(start)
    assert control.solver_stats["success"]


def test_rockit_moves_the_tip(functions):
    rockit = imported("rockit")
    n, start = functions.free, values(functions.states)
    problem = rockit.Ocp(T=0.6)
    q, v, position, velocity = problem.state(n), problem.state(n), problem.state(), problem.state()
    u = problem.control()
    for state, derivative in (
        (q, v),
        (v, accelerations(functions, q, v, position, velocity, u)),
        (position, velocity),
        (velocity, u),
    ):
        problem.set_der(state, derivative)
    for state, value in ((q, start[:n]), (v, start[n:]), (position, 0), (velocity, 0)):
        problem.subject_to(problem.at_t0(state) == value)
    problem.subject_to(problem.at_tf(position) == 0.02)
    problem.subject_to(problem.at_tf(velocity) == 0)
    problem.add_objective(problem.integral(u**2) * 1e-2 + problem.at_tf((q[-4] - 0.02) ** 2) * 1e2)
    problem.set_initial(q, start[:n])
    limited = {"ipopt.hessian_approximation": "limited-memory", "ipopt.print_level": 0, "print_time": 0}
    problem.solver("ipopt", limited)
    problem.method(rockit.DirectCollocation(N=10, degree=3))
    solution = problem.solve()
    assert solution.sample(q, grid="control")[1][-1][-4] == pytest.approx(0.02, abs=2e-3)
