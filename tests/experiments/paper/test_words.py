"""What the study's page says of numbers that follow from the rig file."""

from dataclasses import replace

from experiments.paper.study_report import play_words
from rig.parameters import Rig


def test_the_twist_that_is_taken_off_is_that_of_the_rig_file():
    soft = replace(Rig().drive, joint_stiffness_nm_rad=3.0)
    assert "(0.076 deg in the joints)" in play_words(Rig())
    assert "(0.76 deg in the joints)" in play_words(Rig(drive=soft))
