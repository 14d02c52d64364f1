"""Designs of experiments against closed forms and brute force."""

from itertools import combinations, combinations_with_replacement

import numpy as np
import pytest

from problems.planning.design import Design, ExpectedRecord, best_subset

POINTS = np.linspace(-1.0, 1.0, 21)
PARABOLA = np.array([np.outer(row, row) for row in np.vander(POINTS, 3)])  # a parabola measured at points


def design(informations, costs=None, prior=None):
    count, n = informations.shape[:2]
    costs = np.ones(count) if costs is None else costs
    return Design(informations, np.zeros((n, n)) if prior is None else prior, 1e-9, costs)


def random_design(seed, count=6, n=3):
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((count, 2, n))
    return design(np.einsum("kri,krj->kij", rows, rows), rng.uniform(0.5, 2.0, count), 1e-3 * np.eye(n))


def expected(jacobian, shared, prior_jacobian=None):
    m, columns = jacobian.shape
    prior_jacobian = np.zeros((0, columns)) if prior_jacobian is None else prior_jacobian
    times = np.tile(np.arange(m // 2) / 10.0, 2)
    return ExpectedRecord(jacobian, shared, prior_jacobian, (m // 2, m // 2), np.array([0.1, 0.2]), times, 1e-9, 1.0)


def test_d_optimal_shares_of_a_parabola_are_a_third_at_the_ends_and_the_middle():
    parabola = design(PARABOLA)
    shares = parabola.shares(1.0, None)
    assert shares[[0, 10, 20]] == pytest.approx(1 / 3, abs=1e-5)
    assert parabola.gains(shares, None).max() == pytest.approx(3.0, rel=1e-5)


def test_the_curvature_of_a_parabola_is_best_measured_half_the_time_in_the_middle():
    shares = design(PARABOLA).shares(1.0, np.array([1.0, 0.0, 0.0]))
    assert shares[[0, 10, 20]] == pytest.approx([0.25, 0.5, 0.25], abs=1e-4)


@pytest.mark.parametrize("goal", [None, np.ones(3), np.array([0.0, 1.0, 0.0])], ids=["D", "A", "one"])
@pytest.mark.parametrize("seed", range(3))
def test_optimal_shares_satisfy_the_equivalence_theorem(seed, goal):
    random_plan, budget = random_design(seed), 7.0
    shares = random_plan.shares(budget, goal)
    gains = random_plan.gains(shares * budget / random_plan.costs, goal) * budget / random_plan.costs
    assert shares.sum() == pytest.approx(1.0) and (shares >= 0.0).all()
    assert gains.max() == pytest.approx(shares @ gains, rel=1e-4)


@pytest.mark.parametrize("goal", [None, np.ones(3), np.array([0.0, 1.0, 0.0])], ids=["D", "A", "one"])
@pytest.mark.parametrize("seed", range(5))
def test_exchange_finds_the_best_of_all_lists(seed, goal):
    plan_, budget = random_design(seed), 5.0
    lists = [
        np.bincount(subset, minlength=6)
        for size in range(1, 11)
        for subset in combinations_with_replacement(range(6), size)
    ]
    best = min(float(plan_.loss(plan_.total(list), goal)) for list in lists if list @ plan_.costs <= budget)
    counts = plan_.counts(budget, goal)
    assert counts @ plan_.costs <= budget
    loss = float(plan_.loss(plan_.total(counts), goal))
    assert loss == pytest.approx(best, rel=1e-9)


def test_a_limit_of_repetitions_is_kept():
    counts = random_design(0).counts(8.0, None, most_each=1)
    assert counts.max() == 1


def test_own_unknowns_are_marginalised_with_their_priors():
    rng = np.random.default_rng(0)
    jacobian, prior_jacobian = rng.standard_normal((40, 5)), np.array([[0.0, 0.0, 0.0, 2.0, 0.0]])
    information = jacobian.T @ jacobian + prior_jacobian.T @ prior_jacobian
    covariance = np.linalg.inv(information)[:3, :3]
    record = expected(jacobian, 3, prior_jacobian)
    assert np.linalg.inv(record.information) == pytest.approx(covariance)
    half = jacobian[:20].T @ jacobian[:20] + prior_jacobian.T @ prior_jacobian
    assert np.linalg.inv(record.series_information([0])) == pytest.approx(np.linalg.inv(half)[:3, :3])
    assert record.informations_until(np.array([0.9, 1.9]))[-1] == pytest.approx(record.information)


def test_an_undetermined_unknown_of_a_record_costs_no_information_but_its_own():
    rng = np.random.default_rng(1)
    jacobian = rng.standard_normal((40, 4))
    jacobian[:, 3] = 0.0
    assert expected(jacobian, 3).information == pytest.approx(jacobian[:, :3].T @ jacobian[:, :3])


def test_what_is_not_determined_has_an_infinite_error():
    separate = design(np.array([np.diag([4.0, 0.0]), np.diag([0.0, 1.0])]))
    assert separate.errors(separate.total(np.array([1.0, 0.0]))).tolist() == [0.5, np.inf]
    joint = design(np.array([np.ones((2, 2))]))
    assert np.isinf(joint.errors(joint.total(np.ones(1)))).all()


def test_the_best_subset_is_that_of_brute_force():
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((12, 3))

    def loss(chosen):
        chosen_rows = rows[list(chosen)]
        return -float(np.linalg.slogdet(chosen_rows.T @ chosen_rows + 1e-9 * np.eye(3))[1])

    assert loss(best_subset(4, 12, loss)) == pytest.approx(min(map(loss, combinations(range(12), 4))))
