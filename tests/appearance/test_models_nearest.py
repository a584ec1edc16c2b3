"""Nearest colour outside the domain of a model's inverse, without a jump."""

import numpy as np
import pytest

from tests.appearance._models import D65, colours
from tests.appearance.test_models_edges import ENDS
from volspec.appearance import ViewingConditions
from volspec.appearance.models import APPEARANCE_MODELS, hunt, nayatani95
from volspec.appearance.models.cielab import cielab
from volspec.appearance.models.numeric import nearest_inverse
from volspec.appearance.scene_to_display import ModelTransform

SCENE = ViewingConditions(D65, 63.66)
DIM = ViewingConditions(D65, 0.1)


@pytest.mark.parametrize("each", [hunt, nayatani95])
@pytest.mark.parametrize("where", ENDS)
def test_every_finite_colour_has_a_finite_one_on_every_display(each, where):
    rng = np.random.default_rng(1)
    XYZ = np.concatenate([rng.uniform(-size, size, (10, 3)) for size in (1e5, 100.0, 1e-6, 0.0)])
    for display in ENDS.values():
        shown = ModelTransform(each, each.forward, ENDS[where], display).apply(XYZ)
        assert np.isfinite(shown).all(), display


@pytest.mark.parametrize("name", APPEARANCE_MODELS)
def test_what_the_inverse_knows_is_not_touched(name):
    model = APPEARANCE_MODELS[name]
    seen = model.forward(colours(D65, 500), SCENE)
    plain = model.continued(seen.J, seen.C, seen.h, SCENE)
    near = nearest_inverse(model, seen.J, seen.C, seen.h, SCENE)
    np.testing.assert_array_equal(near, plain)
    one = nearest_inverse(model, seen.J[3], seen.C[3], seen.h[3], SCENE)
    np.testing.assert_allclose(one, plain[3], rtol=1e-12)


def largest_step(shown):
    """Along ramps (R, N, 3), in CIELAB; what is brighter than the display is cut as it cuts."""
    Lab = cielab(np.clip(shown, 0.0, np.asarray(D65)), D65)
    return np.linalg.norm(np.diff(Lab, axis=1), axis=-1).max(axis=1)


def test_hunt_on_a_dim_display_has_no_jump_where_its_inverse_ends():
    """Paths from grey to blues and to black: finer steps are smaller ones, as for no jump."""
    ends = np.array([[20.0, -2.0, 110.0], [15.0, 1.0, 90.0], [10.1, 2.2, 50.0], [0.0, 0.0, 0.0]])
    start = 0.2 * np.asarray(D65)

    def ramps(count):
        t = np.linspace(0.0, 1.0, count)[:, None]
        return start + t * (ends[:, None, :] - start)

    transform = ModelTransform(hunt, hunt.forward, SCENE, DIM)
    seen = hunt.forward(ramps(2001), SCENE)
    known = np.isfinite(hunt.continued(seen.J, seen.C, seen.h, DIM)).all(axis=-1)
    assert not known.all(axis=1).any() and known.any(axis=1).all()
    coarse, fine = (largest_step(transform.apply(ramps(n))) for n in (2001, 16001))
    # Eight times as many steps, of a fifth; jumps would stay. By black one of L* .2 does.
    assert np.all(fine <= np.maximum(0.2 * coarse, 0.3)), (coarse, fine)


def test_hue_stays_and_lightness_where_a_grey_has_it():
    seen = hunt.forward([15.0, 1.0, 90.0], SCENE)
    near = hunt.forward(nearest_inverse(hunt, seen.J, seen.C, seen.h, DIM), DIM)
    assert near.C < seen.C
    assert float(near.h) == pytest.approx(float(seen.h), abs=1e-6)
    assert float(near.J) == pytest.approx(float(seen.J), abs=1e-6)
