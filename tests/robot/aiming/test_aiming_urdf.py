from __future__ import annotations

import numpy as np
import pytest

from robot.aiming import ArmModel, parse_urdf
from robot.errors import ConfigError


def test_the_shipped_arm_has_six_limited_joints_and_a_nozzle_ahead_of_the_last(model: ArmModel) -> None:
    assert model.joint_names == ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate")
    assert np.degrees(model.lower_rad) == pytest.approx([-180, -106, -101, -180, -107, -180], abs=1e-3)
    assert np.degrees(model.upper_rad) == pytest.approx([180, 72, 92, 180, 128, 180], abs=1e-3)
    assert (model.velocity_rad_s == 1.5).all()
    assert model.last_from_nozzle.translation_m == pytest.approx([0.07, 0, 0])


def test_every_link_of_the_shipped_arm_has_a_capsule(model: ArmModel) -> None:
    assert {item.link for item in model.capsules} == set(range(7))


def test_a_cylinder_becomes_the_capsule_on_its_axis(model: ArmModel) -> None:
    upper_arm = next(item.capsule for item in model.capsules if item.link == 2)
    assert sorted([upper_arm.start_m[2], upper_arm.end_m[2]]) == pytest.approx([0.08, 0.30])
    assert upper_arm.radius_m == 0.03


def test_fixed_links_beside_the_chain_carry_their_capsules_along(urdf_text: str, model: ArmModel) -> None:
    valve = """
      <link name="valve"><collision><geometry><cylinder radius="0.02" length="0"/></geometry></collision></link>
      <joint name="valve_fixed" type="fixed">
        <parent link="wrist_link"/><child link="valve"/><origin xyz="0 0 0.04"/>
      </joint></robot>"""
    with_valve = parse_urdf(urdf_text.replace("</robot>", valve))
    added = next(item for item in with_valve.capsules if item.name == "valve")
    assert added.link == 5
    assert added.capsule.start_m == pytest.approx([0, 0, 0.04])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<robot name="viperx300_nozzle">', "<robot", "expected a URDF"),
        ("robot", "sdf", "top element <robot>"),
        ('"nozzle"', '"tip"', "expected a link named 'nozzle'"),
        ('"elbow" type="revolute"', '"elbow" type="prismatic"', "'elbow' of type revolute or fixed, found 'prismatic'"),
        ('<limit lower="-1.76278254" ', '<limits lower="-1.76278254" ', "joint 'elbow' with <limit>"),
        ('lower="-1.76278254"', 'lower="2"', "joint 'elbow' with lower < upper"),
        ('upper="1.60570291" velocity="1.5"', 'upper="1.60570291"', "a number 'velocity'"),
        ('upper="1.60570291" velocity="1.5"', 'upper="1.60570291" velocity="0"', "velocity > 0"),
        ('lower="-1.76278254"', 'lower="nan"', "a number 'lower', found 'nan'"),
        ('<origin xyz="0.200 0 0"/>', '<origin xyz="0.200 0"/>', "three numbers in xyz, found '0.200 0'"),
        ('<origin xyz="0.200 0 0"/><axis xyz="1 0 0"/>', '<origin xyz="0.200 0 0"/><axis xyz="1 1 0"/>', "a unit axis"),
        ('<parent link="wrist_link"/>', '<parent link="wirst_link"/>', "parent 'wirst_link'"),
        ('<cylinder radius="0.025" length="0.060"/>', '<box size="1 1 1"/>', "cylinders as collision geometry"),
        ('radius="0.025"', 'radius="-1"', "radius > 0"),
        ('<link name="nozzle"/>', '<link name="nozzle"/><link name="nozzle"/>', "one link named 'nozzle'"),
        ('<link name="nozzle"/>', '<link name="nozzle"/><link name="lamp"/>', "link 'lamp' joined to the arm"),
        ('<child link="shoulder_link"/>', '<child link="upper_arm_link"/>', "one joint above link 'upper_arm_link'"),
    ],
)
def test_a_bad_description_is_refused_with_what_was_expected(urdf_text: str, old: str, new: str, message: str) -> None:
    assert old in urdf_text
    with pytest.raises(ConfigError) as raised:
        parse_urdf(urdf_text.replace(old, new), "arm.urdf")
    assert str(raised.value).startswith("arm.urdf: expected ")
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)
