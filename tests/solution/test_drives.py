"""Drives of several pulleys: what is read from fields, the certificate, and how they show themselves."""

import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import DISTANCE, RADIUS, RATE, SLACK, SLIP, TIGHT, stretch, two_pulleys

from belt_fenicsx import Pulley, Scene, Solution, StiffnessBelt, Sweep, bvp, solve
from belt_fenicsx.command import main as cli
from belt_fenicsx.command import reports
from belt_fenicsx.solution import plot
from belt_fenicsx.solution.certificate import certify
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.report import as_text, certificates
from belt_fenicsx.solution.summary import as_json, certificates_as_json, difference_of_omega

pytestmark = pytest.mark.serial
VIEWS = [("right", 0.0, 0j), ("left", 0.0, 0j), ("right", 0.7, 5 + 3j), ("left", -2.0, -1j)]
TORQUE = RADIUS * (TIGHT - SLACK)


@pytest.fixture(scope="module")
def drive():
    return two_pulleys()


def violated(solution, **changed):
    """Titles of the checks that fail when fields are changed."""
    changed = replace(solution, fields=replace(solution.fields, **changed))
    return {check.title for check in certify(changed, tolerance=1e-9, balance=1e-7) if not check.holds}


@pytest.mark.parametrize(("side", "turned", "moved"), VIEWS)
def test_numbers_of_contacts_and_spans(side, turned, moved):
    solution = two_pulleys(side, turned, moved)
    first, second = solution.contacts
    sign = 1.0 if side == "right" else -1.0
    assert (first.pulley, second.pulley) == (0, 1)
    assert [zone.pulley for zone in solution.zones] == [0, 0, None, 1, 1, None]
    for contact in (first, second):
        assert contact.wrap_angle == pytest.approx(math.pi, rel=1e-12)
        assert contact.slip_angle == pytest.approx(SLIP, rel=1e-12)
        assert contact.take_up == 0.0
        assert abs(complex(*contact.hub_force)) == pytest.approx(TIGHT + SLACK, rel=1e-12)
    towards = np.exp(1j * turned)
    assert complex(*first.hub_force) == pytest.approx((TIGHT + SLACK) * towards, rel=1e-12)
    assert complex(*second.hub_force) == pytest.approx(-(TIGHT + SLACK) * towards, rel=1e-12)
    assert complex(*first.run_up) == pytest.approx(moved - sign * 1j * RADIUS * towards, abs=1e-14)
    angles = [first.angle_up, first.angle_off, second.angle_up, second.angle_off]
    assert angles == pytest.approx([sign * angle + turned for angle in (math.pi, 0.0, 0.0, -math.pi)], abs=1e-12)
    assert first.sliding_loss == pytest.approx(second.sliding_loss, rel=1e-8)
    assert (first.capacity, math.isnan(second.capacity)) == (120.0, True)

    tight, slack = solution.spans
    for span, F, angle in ((tight, TIGHT, 0.0), (slack, SLACK, -math.pi)):
        T = F + 20.0 * stretch(F)
        assert span.tension == pytest.approx([T, T, T], rel=1e-12)
        assert span.length == pytest.approx(DISTANCE / stretch(F), rel=1e-12)
        assert span.speed == pytest.approx(RATE * stretch(F), rel=1e-12)
        assert span.angle == pytest.approx(sign * angle + turned, abs=1e-12)
        assert span.sag == pytest.approx(0.0, abs=1e-14)


def test_power(drive):
    lost = TORQUE * RATE * (stretch(TIGHT) - stretch(SLACK)) / RADIUS
    assert drive.power == pytest.approx(TORQUE * RATE * stretch(TIGHT) / RADIUS, rel=1e-12)
    assert drive.losses == pytest.approx(lost, rel=1e-8)
    assert drive.efficiency == pytest.approx(stretch(SLACK) / stretch(TIGHT), rel=1e-8)
    assert math.isnan(bvp.solve(Scene(), rtol=1e-4).efficiency)
    failed = replace(drive, contacts=())
    assert math.isnan(failed.power) and math.isnan(failed.losses) and math.isnan(failed.efficiency)


@pytest.mark.parametrize(("side", "turned", "moved"), VIEWS)
def test_the_string_is_admissible(side, turned, moved):
    solution = two_pulleys(side, turned, moved)
    assert solution.success
    on_each = [
        "no penetration outside contact",
        "positive pressure in contact",
        "Coulomb's bound in stick",
        "sense of sliding in slip",
    ]
    balances, drives = ["balance of forces", "balance of moments"], ["drive met"]
    whole = ["loop closed", "balance of hub loads", "balance of power"]
    assert [(check.name, check.pulley) for check in solution.checks] == [
        ("joints in order", None),
        *((name, pulley) for pulley in (0, 1) for name in on_each),
        *((name, pulley) for pulley in (0, 1) for name in balances),
        *((name, pulley) for pulley in (0, 1) for name in drives),
        *((name, None) for name in whole),
    ]


def test_pressure_and_friction_are_judged_pulley_by_pulley(drive):
    fields = drive.fields
    p, v_rel = fields.p.copy(), fields.v_rel.copy()
    p[np.flatnonzero(fields.zone == 3)[50]] *= -1e-3
    v_rel[fields.zone == 1] *= -1.0
    assert "positive pressure in contact, pulley 1" in violated(drive, p=p)
    assert violated(drive, v_rel=v_rel) == {"sense of sliding in slip, pulley 0"}
    f = np.where(fields.zone == 0, 0.51 * fields.p, fields.f)
    assert "Coulomb's bound in stick, pulley 0" in violated(drive, f=f)


def test_balances_tell_the_pulley(drive):
    fields = drive.fields
    p = np.where(fields.zone == 3, 1.001 * fields.p, fields.p)
    assert violated(drive, p=p) == {"balance of forces, pulley 1"}
    M = np.where(fields.zone == 2, 0.01, 0.0)
    assert violated(drive, M=M) == {"balance of moments, pulley 0", "balance of moments, pulley 1"}


def test_a_span_is_kept_off_every_pulley():
    """The touching fibre on a pulley's side is what may not enter it."""
    drive = two_pulleys()
    between = Pulley(radius=0.05, center=(0.2, 0.1501), friction=0.5, side="left", torque=0.0)
    for offset, hit in ((0.0, False), (2e-4, True)):
        scene = replace(drive.scene, belt=replace(drive.scene.belt, contact_offset=offset))
        object.__setattr__(scene, "pulleys", (*scene.pulleys, between))
        checks = certify(replace(drive, scene=scene), tolerance=1e-9)
        (check,) = [c for c in checks if c.name == "no penetration outside contact" and c.pulley == 2]
        assert check.holds != hit
        assert check.margin == pytest.approx((1e-4 - offset) / 0.05, rel=1e-9)


def test_a_loop_has_to_be_closed(drive):
    r, theta = drive.fields.r.copy(), drive.fields.theta.copy()
    r[-1] += (0.0, 1e-6)
    theta[-1] += 2.0 * math.pi
    assert "loop closed" in violated(drive, r=r)
    assert "loop closed" in violated(drive, theta=theta)


def test_a_drive_that_is_missed(drive):
    first, second = drive.contacts
    for wrong in (replace(first, omega=first.omega * (1.0 + 1e-9)), replace(second, torque=second.torque * 1.000001)):
        contacts = tuple(wrong if contact.pulley == wrong.pulley else contact for contact in drive.contacts)
        checks = certify(replace(drive, contacts=contacts), tolerance=1e-9)
        assert {c.pulley for c in checks if c.name == "drive met" and not c.holds} == {wrong.pulley}


@pytest.mark.parametrize("drag", [0.0, 0.5])
@pytest.mark.parametrize("driven", ["slip_angle", "torque"])
def test_each_kind_of_drive(driven, drag):
    drag = drag if driven == "torque" else 0.0
    plain = two_pulleys(certificate=False)
    omega = plain.contacts[1].omega
    values = {"slip_angle": {"slip_angle": SLIP, "slip": "backward"}, "torque": {"torque": -TORQUE - drag * omega}}
    pulleys = [plain.scene.pulleys[0], replace(plain.scene.pulleys[1], torque=None)]
    pulleys[1] = replace(pulleys[1], **values[driven], drag=drag)
    assert two_pulleys(pulleys=tuple(pulleys)).success
    name, value = next(iter(values[driven].items()))
    pulleys[1] = replace(pulleys[1], **{name: value * (1.0 + 1e-6)})
    assert [c.title for c in two_pulleys(pulleys=tuple(pulleys)).checks if not c.holds] == ["drive met, pulley 1"]


@pytest.mark.parametrize("force", [TIGHT + SLACK, 2590.0])
def test_a_take_up_has_its_force(force):
    plain = two_pulleys(certificate=False)
    first, second = plain.scene.pulleys
    solution = two_pulleys(pulleys=(first, replace(second, take_up=(2.0, 0.0), force=force)))
    assert {c.title for c in solution.checks if not c.holds} == (
        set() if force == TIGHT + SLACK else {"force of the take-up, pulley 1"}
    )


def test_power_that_is_lost_is_noticed(drive):
    contacts = tuple(replace(contact, sliding_loss=0.999 * contact.sliding_loss) for contact in drive.contacts)
    failed = [c.name for c in certify(replace(drive, contacts=contacts), tolerance=1e-9, balance=1e-7) if not c.holds]
    assert failed == ["balance of power"]


@pytest.mark.parametrize("method", ["fitted", "bvp"])
def test_clamps_take_their_share_of_power_and_load(method):
    """The same belt, asked for by its clamps: the whole belt is in balance with what these put in."""
    solution = solve(Scene(), method=method, rtol=1e-10)
    scene = replace(solution.scene, clamps=((-0.5, 0.0, 0.0), (0.5, 0.0, 0.0)))
    checks = certify(replace(solution, scene=scene), tolerance=1e-6, balance=1e-6)
    assert [check.name for check in checks[-2:]] == ["balance of hub loads", "balance of power"]
    assert all(check.holds for check in checks)


@pytest.mark.parametrize("d", [0.02, -0.02])
def test_strains_from_the_touching_fibre(d):
    """D and phi of the fibre r - d e2 of any curve give the strains of its middle line."""
    belt = StiffnessBelt(bending_stiffness=2.0, extensional_stiffness=3.0, shear_stiffness=5.0)
    sigma = np.linspace(0.0, 1.0, 7)
    theta, kappa = np.sin(2.0 * sigma), 2.0 * np.cos(2.0 * sigma)
    eps, Gamma = 0.1 * sigma, 0.05 * np.cos(sigma)
    fibre = (1.0 + eps + d * kappa + 1j * Gamma) * np.exp(1j * theta)
    zero = np.zeros(7)
    fields = Fields.from_state(
        belt, zone=np.zeros(7, dtype=int), sigma=sigma, r=np.zeros((7, 2)), theta=theta, phi=np.angle(fibre),
        D=np.abs(fibre), kappa=kappa, p=zero, f=zero, v_rel=zero, rate=1.0, offset=np.full(7, d),
    )  # fmt: skip
    assert fields.eps == pytest.approx(eps, abs=1e-14) and fields.Gamma == pytest.approx(Gamma, abs=1e-14)
    assert fields.Q == pytest.approx(np.column_stack([3.0 * eps, 5.0 * Gamma]), abs=1e-14)


def test_text(drive):
    text = as_text(drive)
    for part in (
        "transport rate",
        "efficiency",
        "torque [N m]",
        "stick, forward slip",
        "tension before [N]",
        "sag [m]",
    ):
        assert part in text
    assert "take-up" not in text and text.endswith("admissible.")
    assert "omega = 30.612244898 rad/s, torque = 60 N m, omega = 30.97" in repr(drive)
    page = drive._repr_html_()
    assert page.count("<table>") == 3 and page.count("<img") == 1


def test_json(drive):
    plain = json.loads(as_json(drive))
    assert plain["omega"] is None and plain["transport_rate"] == RATE
    assert [contact["power"] for contact in plain["contacts"]] == [c.power for c in drive.contacts]
    assert plain["contacts"][1]["capacity"] is None
    assert plain["spans"][0]["tension"] == list(drive.spans[0].tension)
    assert plain["efficiency"] == drive.efficiency


def test_files(drive, tmp_path):
    drive.save(tmp_path / "drive.npz")
    again = Solution.load(tmp_path / "drive.npz")
    assert again == drive and again.efficiency == drive.efficiency


def test_certificates_of_a_drive_and_its_string(drive):
    string = replace(drive, method="string", contacts=(drive.contacts[0], replace(drive.contacts[1], omega=30.0)))
    text = certificates([drive, string])
    assert "pulley 1: omega 30 rad/s" in text and "limit without bending" in text and "loop closed" in text
    assert difference_of_omega([drive, string]) == pytest.approx((drive.contacts[1].omega - 30.0) / 30.97238896)
    checks = json.loads(certificates_as_json([drive, string]))["solutions"][0]["checks"]
    assert [check["pulley"] for check in checks[:2]] == [None, 0]


def test_pictures(drive):
    figure = plot.overview(drive)
    belt, p, *_ = figure.axes
    assert len(belt.patches) == 2 and p.get_xlabel() == r"$\sigma$ [m]"
    assert [text.get_text() for text in belt.texts if text.get_text()] == ["0", "1"]
    for (low, high), place in ((belt.get_xlim(), (-0.1, 0.5)), (belt.get_ylim(), (-0.1, 0.1))):
        assert low < place[0] and high > place[1]
    figure.savefig(io.BytesIO(), format="png")


def test_columns_of_a_sweep(drive):
    table = Sweep(over="pulleys.1.torque", values=(-60.0, -70.0), solutions=(drive, replace(drive, contacts=())))
    head, first, second = table.rows()
    assert head[1:6] == [
        "transport_rate [m/s]",
        "pulleys.0.omega [rad/s]",
        "pulleys.0.torque [N m]",
        "pulleys.1.omega [rad/s]",
        "pulleys.1.torque [N m]",
    ]
    assert first[1:6] == [RATE, *(value for c in drive.contacts for value in (c.omega, c.torque))]
    assert table["pulleys.1.torque"][0] == drive.contacts[1].torque and math.isnan(second[2])
    with pytest.raises(KeyError):
        table["omega"]


def test_command_line(drive, monkeypatch, capsys, tmp_path):
    import tomli_w

    from belt_fenicsx.scene.file import scene_to_dict

    path = tmp_path / "drive.toml"
    path.write_text(tomli_w.dumps(scene_to_dict(drive.scene)))
    asked = []

    def solver(args, petsc, method):
        asked.append(method)
        return lambda scene, **_: drive

    monkeypatch.setattr(reports, "solver", solver)
    assert cli.main([str(path)]) == 0
    assert "tension before [N]" in capsys.readouterr().out
    assert cli.main(["check", str(path)]) == 0
    assert asked == [None, None, "bvp"]
    assert capsys.readouterr().out.count("loop closed") == 2
    assert cli.main(["sweep", str(path), "--over", "pulleys.1.torque=-60,-61"]) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.startswith("pulleys.1.torque,transport_rate [m/s],pulleys.0.omega [rad/s]") and len(rows) == 2


def test_methods_without_petsc_refuse_its_options(drive, capsys, tmp_path):
    import tomli_w

    from belt_fenicsx.scene.file import scene_to_dict

    path = tmp_path / "drive.toml"
    path.write_text(tomli_w.dumps(scene_to_dict(drive.scene)))
    assert cli.main([str(path), "--method", "bvp", "-belt_snes_monitor"]) == 2
    assert "be left out with the method bvp, which runs without PETSc" in capsys.readouterr().err
