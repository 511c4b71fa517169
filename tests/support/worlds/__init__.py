"""Worlds that share no code with the product: logs that show known classes of failure.

`WORLDS[name](seed)` gives the log's columns, a rig file and what is really there.
"""

from tests.support.worlds import (
    axes,
    commanded,
    default_mujoco,
    healthy,
    position_mujoco,
    positions,
    strangers,
    tables,
)

WORLDS = {
    f.__name__: f
    for f in (
        tables.wide_dead_zone_table,
        tables.k_far_off,
        tables.soft_friction,
        tables.loaded_joint,
        tables.falling_joint,
        tables.coasting_gears,
        tables.bowl,
        tables.touched_bowl,
        tables.touched_crooked,
        tables.walls,
        tables.five_runs,
        positions.late_camera_100ms_at_30hz,
        positions.late_camera_100ms_at_60hz,
        positions.late_camera_100ms_at_100hz,
        positions.late_camera_250ms_at_30hz,
        positions.late_camera_250ms_at_60hz,
        positions.late_camera_250ms_at_100hz,
        positions.home_made_table,
        *commanded.WORLDS,
        axes.wide_dead_zone,
        axes.bare_motor,
        axes.asymmetric_viscous,
        axes.gyro_dead_zone,
        axes.healthy_axis,
        strangers.heavy_sided_ball,
        strangers.wavy_plate,
        strangers.slipping_encoder,
        strangers.pendulum,
        strangers.cable,
        strangers.elastic_belt,
        strangers.twisting_plate,
        strangers.centred_play,
        strangers.losing_bridge,
        strangers.fan,
        strangers.swaying_floor,
        strangers.slipping_ball,
        default_mujoco.mujoco_friction,
        default_mujoco.mujoco_friction_of_one_axis,
        default_mujoco.mujoco_gears,
        default_mujoco.mujoco_joint,
        default_mujoco.mujoco_walls,
        default_mujoco.mujoco_slipping_ball,
        healthy.plain,
        healthy.rubbing_joints,
        healthy.coloured_torque,
        healthy.pink_drift,
        healthy.limit_cycle,
        healthy.double_noise,
    )
} | position_mujoco.WORLDS
