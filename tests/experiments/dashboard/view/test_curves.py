"""The charts of the live table or of a film."""

import numpy as np

from experiments.dashboard.server.server import open_server
from experiments.dashboard.view.curves import FILM, Curves
from rig.log import INDEX
from rig.parameters import Rig


def test_a_film_without_curves_explains_no_curves():
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    try:
        curves = Curves(server, Rig().servo, "a film")
        legend, _, words, *plots = curves.handles
        curves.rest(FILM)
        assert (legend.visible, words.content) == (False, FILM)
        assert not any(plot.visible for plot in plots)
        curves.draw(np.zeros((2, len(INDEX))))
        assert (legend.visible, words.content) == (True, "")
        assert plots[-1].visible
    finally:
        server.stop()
