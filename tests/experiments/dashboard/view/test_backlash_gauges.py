"""The gauges of the backlash, which whoever guesses does not see."""

import numpy as np

from experiments.dashboard.server.server import open_server
from experiments.dashboard.view.backlash_gauges import TEETH, BacklashGauges
from experiments.runs.assemble import load_rig


def test_the_gauges_tell_the_truth_and_are_hidden_as_one():
    rig = load_rig(None)
    server, _ = open_server("127.0.0.1", 0, "a-token-of-some-length-for-tests")
    try:
        gauges = BacklashGauges(server, rig)
        nothing = np.zeros(2)
        gauges.draw(rig, nothing, nothing, np.full((2, 2), np.nan))
        labels = [gauge._label for gauge in gauges._gauges.values()]
        assert all("true 1" in label.text for label in labels)
        for (kind, _), gauge in gauges._gauges.items():  # none lies over the servo's other gauge
            up = {"gear": -1, "joint": 1}[kind]
            assert np.sign(gauge._label.position[2]) == up
            assert gauge._label.anchor == {-1: "top-center", 1: "bottom-center"}[up]
        gauges.tell(False)
        gauges.draw(rig, nothing, nothing, np.full((2, 2), 0.01))
        assert next(label.text for label in labels) == "play of gear x:\nfound 0.6°"
        gauges.show(False)
        assert not gauges._root.visible
        assert all(label.name.startswith(f"{TEETH}/") for label in labels)  # hidden with it
        gauges.show(True)
        assert gauges._root.visible
    finally:
        server.stop()
