"""The command line keeps its promises: exit status, a line for a mistake, one JSON object, nothing half-written."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import drakeplan.query.planning
from drakeplan import playback
from drakeplan.cli import COMMANDS, main
from drakeplan.cli.output import print_json
from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import read_plan, write_plan
from drakeplan.progress import ProgressEvent
from drakeplan.query.options import PlanOptions, with_options
from drakeplan.query.result import PlanResult
from scenes.input_error import InputError
from scenes.library.flat import named as flat

REPORT_KEYS = {
    "status", "reason", "cost", "bound", "contacts", "stances", "palms_used", "time_to_first_s",
    "time_to_first_feasible_s", "planning_s", "dynamics_s", "motion_s", "total_s", "peak_rss_mb", "verified", "files",
}  # fmt: skip


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """What was said on standard error, which must be one line; standard output must be empty."""
    said = capsys.readouterr()
    assert said.out == ""
    assert "Traceback" not in said.err
    assert len(said.err.splitlines()) == 1, said.err
    return said.err


# ---- words


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("pla flat", "did you mean play, plan"),
        ("plan", "SCENE is missing"),
        ("plan flat rubble", "unexpected argument 'rubble'"),
        ("plan flat --sede 3", "--sede: did you mean --seed"),
        ("plan flat -x", "unknown option -x"),
        ("plan flat --seed", "--seed: a value is missing"),
        ("plan flat --seed --json=no", "--seed: a value is missing"),
        ("plan flat --seed x", "--seed: expected a whole number, got 'x'"),
        ("plan flat --seed 1.5", "--seed: expected a whole number, got '1.5'"),
        ("plan flat --seed -1", "--seed: expected 0 or more"),
        ("plan flat --expansions 0", "--expansions: expected 1 or more"),
        ("plan flat --deadline soon", "--deadline: expected a finite number, got 'soon'"),
        ("plan flat --deadline nan", "--deadline: expected a finite number, got 'nan'"),
        ("plan flat --friction inf", "--friction: expected a finite number, got 'inf'"),
        ("plan flat --friction -0.1", "--friction: expected 0 or more"),
        ("plan flat --goal-radius -1", "--goal-radius: expected 0 or more"),
        ("plan flat --cone round", "--cone: unknown 'round'"),
        ("plan flat --cone iner", "did you mean inner"),
        ("plan flat --planner magic", "--planner: unknown 'magic'"),
        ("plan flat --start 1", "--start: expected two or three numbers, X Y [YAW], got 1"),
        ("plan flat --start here", "got here"),
        ("plan flat --start 0 nan", "--start: expected a finite number, got 'nan'"),
        ("plan flat --goal 1 2 3 4", "unexpected argument '4'"),
        ("plan flatt", "unknown scene 'flatt': did you mean flat"),
        ("plan flat --robot eshcer", "unknown robot 'eshcer': did you mean escher"),
        ("plan flat --out no/such/folder/plan.h5", "there is no folder no/such/folder"),
        ("plan flat --html /dev/null/page.html", "cannot be written"),
        ("plan flat --out same --html same", "--out and --html name the same file"),
        ("verify", "PLAN.h5 is missing"),
        ("verify nothing.h5", "nothing.h5"),
        ("verify /dev/null", "/dev/null"),
        ("play nothing.h5", "nothing.h5"),
        ("play nothing.h5 --port 80", "--port: expected 1024 to 65535"),
        ("scenes lst", "did you mean list"),
        ("scenes show", "expected: drakeplan scenes show SCENE"),
        ("scenes show flatt", "did you mean flat"),
        ("scenes export flat no/such/folder/flat.yaml", "there is no folder"),
        ("robots --path nobody", "unknown robot 'nobody'"),
        ("bench nothing", "unknown benchmark 'nothing'"),
        ("bench --seeds 0", "--seeds: expected 1 or more"),
        ("collect", "CAMPAIGN is missing"),
        ("plan flat --planner gcs --dynamics exact", "needs --planner search"),
        ("plan flat --shift 0", "timing: shift"),
        ("train", "SURROGATE is missing"),
        ("train dynamic --data x --out y", "did you mean dynamics"),
        ("train dynamics --out y", "--data is missing"),
    ],
)
def test_a_mistake_gets_one_line_that_names_it_and_exit_2(
    words: str, named: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drakeplan.query.planning, "plan_scene", lambda *_: pytest.fail("planning began"))
    assert main(words.split()) == 2
    assert named in one_line(capsys)


@pytest.mark.parametrize(
    "command", ["play", "verify", "simulate", "library add --library plans", "library list --library"]
)
def test_a_name_that_no_file_can_have_is_bad_input(
    command: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*command.split(), "n" * 300]) == 2
    assert "File name too long" in one_line(capsys)


def test_with_json_a_mistake_is_also_an_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "flatt", "--json"]) == 2
    said = capsys.readouterr()
    assert json.loads(said.out) == {"status": "bad input", "reason": said.err.removeprefix("drakeplan: ").rstrip()}


def test_every_command_explains_itself_with_examples(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    overview = capsys.readouterr().out
    for command in COMMANDS:
        assert f"  {command} " in overview
        assert main([command, "--help"]) == 0
        text = capsys.readouterr().out
        assert f"usage: drakeplan {command}" in text
        assert "--json" in text
        assert "examples:" in text


def test_a_defect_is_neither_bad_input_nor_a_verdict(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drakeplan.cli.scenes.run", lambda _: 1 / 0)
    assert main(["scenes", "list"]) == 70
    assert "ZeroDivisionError" in capsys.readouterr().err


def test_json_has_no_numbers_that_json_lacks(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"a": np.float64("nan"), "b": [np.inf, 1.0], "c": np.arange(2), "d": np.int64(3), "e": Path("x")})
    assert json.loads(capsys.readouterr().out) == {"a": None, "b": [None, 1.0], "c": [0, 1], "d": 3, "e": "x"}


@pytest.mark.parametrize("words", [["--help"], ["robots", "--path", "escher"], ["scenes", "list"], ["plan", "--help"]])
def test_small_questions_load_no_library_that_takes_long_to_load(words: list[str]) -> None:
    code = f"import sys; from drakeplan.cli import main; main({words!r}); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    loaded = set(done.stderr.split())
    assert "drakeplan.cli" in loaded
    assert not loaded & {
        "pydrake",
        "numba",
        "scipy",
        "torch",
        "h5py",
        "pyarrow",
        "trimesh",
        "matplotlib",
        "clarabel",
        "piqp",
    }


def test_a_reader_who_leaves_early_is_no_error() -> None:
    command = f"{sys.executable} -m drakeplan scenes list | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert done.stderr == ""


# ---- scenes and robots


def test_scenes_are_listed_shown_and_exported_alike(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes", "list", "--json"]) == 0
    names = [s["name"] for s in json.loads(capsys.readouterr().out)["scenes"]]
    assert {"flat", "stairs", "rubble_field", "rubble_corridor"} <= set(names)
    assert main(["scenes", "show", "rubble_corridor", "--seed", "4", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert main(["scenes", "export", "rubble_corridor", str(tmp_path / "c.yaml"), "--seed", "4"]) == 0
    capsys.readouterr()
    assert main(["scenes", "show", str(tmp_path / "c.yaml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == shown


def test_the_path_of_a_robot_is_all_that_drake_needs(capsys: pytest.CaptureFixture[str]) -> None:
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    assert main(["robots", "--path", "escher"]) == 0
    (path,) = capsys.readouterr().out.splitlines()
    assert Path(path).is_absolute()
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(path)
    plant.Finalize()
    assert (plant.num_positions(), plant.num_velocities()) == (34, 33)


# ---- plan, with a planner that answers at once


@dataclasses.dataclass
class FakePlanner:
    """Stands in for `plan_scene` and remembers what it was asked."""

    result: PlanResult
    options: PlanOptions | None = None

    def __call__(self, scene, robot, options, progress) -> PlanResult:
        self.options = options
        progress(ProgressEvent("search", "", cost=1.0, bound=None, expansions=3))
        return self.result


def fake(monkeypatch: pytest.MonkeyPatch, status: str, reason: str, plan: Plan | None) -> FakePlanner:
    report = {"status": status, "reason": reason, "stances": 3, "contacts": 4, "palms_used": 0, "cost": 2.0}
    report["verified"] = {"holds": status == "complete", "failed": []}
    planner = FakePlanner(PlanResult(status, reason, plan, report))  # type: ignore[arg-type]
    monkeypatch.setattr(drakeplan.query.planning, "plan_scene", planner)
    return planner


def test_a_verified_plan_is_written_and_the_exit_is_0(
    strolling_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fake(monkeypatch, "complete", "", strolling_plan)
    out, page = tmp_path / "plan.h5", tmp_path / "plan.html"
    assert main(["plan", "flat", "--out", str(out), "--html", str(page), "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["files"] == {"plan": str(out), "html": str(page)}
    assert "search" in said.err
    assert read_plan(out).scene_name == strolling_plan.scene_name
    assert page.stat().st_size > 1e6


@pytest.mark.parametrize("keep", [False, True])
def test_contacts_without_a_verified_motion_are_written_only_when_asked_for(
    keep: bool,
    strolling_plan: Plan,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    partial = dataclasses.replace(strolling_plan, phases=None, centroidal=None, motion=None)
    fake(monkeypatch, "contacts", "contacts found, but the motion fails", partial)
    out = tmp_path / "plan.h5"
    assert main(["plan", "flat", "--out", str(out), *(["--keep-partial"] if keep else [])]) == 3
    assert "contacts found, but the motion fails" in capsys.readouterr().err
    assert out.exists() == keep
    if keep:
        assert read_plan(out).status == "contacts"


def test_no_plan_is_exit_3_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fake(monkeypatch, "none", "goal unreachable: it is too far", None)
    assert main(["plan", "flat", "--out", str(tmp_path / "plan.h5"), "--keep-partial", "--json"]) == 3
    said = capsys.readouterr()
    assert json.loads(said.out)["reason"] == "goal unreachable: it is too far"
    assert said.err.splitlines()[-1] == "drakeplan: no complete plan: goal unreachable: it is too far"
    assert not list(tmp_path.iterdir())


def test_degrees_become_radians_and_options_may_come_before_the_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    planner = fake(monkeypatch, "none", "", None)
    main(["plan", "--start", "-0.1", "0.2", "90", "--goal", "1", "-2e-1", "flat", "--seed=7", "--goal_radius", "0.4"])
    options = planner.options
    assert options is not None
    assert options.start == pytest.approx((-0.1, 0.2, np.pi / 2))
    assert options.goal == (1.0, -0.2)
    assert (options.seed, options.goal_radius, options.friction) == (7, 0.4, None)


def test_heights_of_start_and_goal_are_options_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    planner = fake(monkeypatch, "none", "", None)
    main(["plan", "flat", "--goal", "1", "0", "--goal-z", "-1.5", "--start-z=2.4"])
    options = planner.options
    assert options is not None
    assert (options.start, options.start_z, options.goal, options.goal_z) == (None, 2.4, (1.0, 0.0), -1.5)
    placed = with_options(flat(0), options)
    assert placed.start is not None and placed.goal is not None
    assert (placed.start.xyz[2], placed.goal.xyz) == (2.4, (1.0, 0.0, -1.5))


@pytest.mark.parametrize(("words", "palms"), [([], True), (["--no-palms"], False)])
def test_palms_are_used_unless_the_feet_are_to_do_alone(
    words: list[str], palms: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner = fake(monkeypatch, "none", "", None)
    main(["plan", "flat", *words])
    assert planner.options is not None and planner.options.use_palms == palms


def test_a_height_that_is_no_number_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "flat", "--goal-z", "nan"]) == 2
    assert "--goal-z" in one_line(capsys)


def test_a_scene_without_start_or_goal_asks_for_them_and_shows_its_extent(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = dataclasses.replace(flat(0), start=None, goal=None)
    monkeypatch.setattr("scenes.files.scene_source.load_scene", lambda source, *, seed: scene)
    assert main(["plan", "flat"]) == 2
    line = one_line(capsys)
    assert "needs --start and --goal" in line
    assert "x from -0.50 to" in line


def test_the_robot_of_the_scene_is_taken_unless_another_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def refuse(name: str, packages: object = None) -> None:
        asked.append(name)
        raise InputError("that is enough")

    monkeypatch.setattr("scenes.robots.robot.load_robot", refuse)
    monkeypatch.setattr(
        "scenes.files.scene_source.load_scene",
        lambda source, *, seed: dataclasses.replace(flat(0), robot="of_the_scene"),
    )
    for words in ([], ["--robot", "of_the_user"]):
        assert main(["plan", "flat", *words]) == 2
    assert asked == ["of_the_scene", "of_the_user"]


def test_control_c_stops_the_search_and_keeps_what_it_has(
    strolling_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    planner = fake(monkeypatch, "complete", "", strolling_plan)

    def interrupted(scene, robot, options, progress) -> PlanResult:
        assert not options.stop()
        os.kill(os.getpid(), signal.SIGINT)
        assert options.stop()
        return planner(scene, robot, options, progress)

    monkeypatch.setattr(drakeplan.query.planning, "plan_scene", interrupted)
    before = signal.getsignal(signal.SIGINT)
    assert main(["plan", "flat", "--out", str(tmp_path / "plan.h5")]) == 0
    assert "interrupted" in capsys.readouterr().err
    assert (tmp_path / "plan.h5").exists()
    assert signal.getsignal(signal.SIGINT) is before


def test_a_second_control_c_aborts(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def stubborn(*_) -> PlanResult:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        pytest.fail("was not aborted")

    monkeypatch.setattr(drakeplan.query.planning, "plan_scene", stubborn)
    assert main(["plan", "flat"]) == 130
    assert capsys.readouterr().err.splitlines()[-1] == "drakeplan: aborted"


# ---- verify and play


def test_verify_says_1_for_a_plan_that_does_not_hold(
    strolling_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_plan(strolling_plan, tmp_path / "plan.h5")  # nothing in it is physical
    assert main(["verify", str(tmp_path / "plan.h5")]) == 1
    assert "the plan does not hold" in capsys.readouterr().out
    assert main(["verify", str(tmp_path / "plan.h5"), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["holds"] is False
    assert report["failed"]
    assert {"name", "ok", "worst", "limit", "where"} <= set(report["checks"][0])


def test_verify_says_2_for_a_truncated_plan(
    strolling_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_plan(strolling_plan, tmp_path / "plan.h5")
    whole = (tmp_path / "plan.h5").read_bytes()
    (tmp_path / "plan.h5").write_bytes(whole[: len(whole) // 2])
    assert main(["verify", str(tmp_path / "plan.h5")]) == 2
    assert "plan.h5" in one_line(capsys)
    assert main(["play", str(tmp_path / "plan.h5"), "--html", str(tmp_path / "plan.html")]) == 2
    assert "plan.h5" in one_line(capsys)
    assert not (tmp_path / "plan.html").exists()


def test_play_writes_a_page_without_serving(
    strolling_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_plan(strolling_plan, tmp_path / "plan.h5")
    page = tmp_path / "plan.html"
    assert main(["play", str(tmp_path / "plan.h5"), "--html", str(page), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["html"] == str(page)
    assert page.exists()


def test_play_serves_until_it_is_interrupted(strolling_plan: Plan, tmp_path: Path) -> None:
    import urllib.request

    write_plan(strolling_plan, tmp_path / "plan.h5")
    command = [sys.executable, "-m", "drakeplan", "play", str(tmp_path / "plan.h5")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        url = server.stdout.readline().strip()
        assert url.startswith(f"http://{playback.HOST}:")
        with urllib.request.urlopen(url, timeout=10) as answer:
            assert b"MeshCat" in answer.read()
        server.send_signal(signal.SIGINT)
        assert server.wait(timeout=10) == 0


# ---- the real thing


@pytest.mark.slow
def test_flat_ground_is_planned_verified_written_and_verified_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "flat.h5"
    status = main(["plan", "flat", "--expansions", "500", "--first", "--out", str(out), "--json"])
    said = capsys.readouterr()
    report = json.loads(said.out)
    assert status == 0, said.err
    assert set(report) >= REPORT_KEYS
    assert report["verified"] == {"holds": True, "failed": []}
    assert report["total_s"] > report["planning_s"]
    assert main(["verify", str(out)]) == 0


@pytest.mark.slow
def test_a_deadline_of_a_millisecond_is_exit_3_with_that_reason(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "rubble_corridor", "--deadline", "0.001", "--json"]) == 3
    said = capsys.readouterr()
    assert "deadline" in json.loads(said.out)["reason"]
    assert "deadline" in said.err.splitlines()[-1]


def test_scenes_show_draws_what_was_understood_and_names_areas_floors_and_notes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tiles = "".join(
        f"  - {{name: t{x}, vertices: [[{x},0,0],[{x + 1},0,0],[{x + 1},1,0.002],[{x},1,0]]}}\n" for x in range(3)
    )
    wall = "  - {name: wall, vertices: [[0,1,0],[3,1,0],[3,1,2],[0,1,2]]}\n"
    head = "format: drakeplan-scene\nversion: 1\nstart: {xyz: [0.5, 0.5, 0]}\ngoal: {xyz: [2.5, 0.5, 0]}\nsurfaces:\n"
    (tmp_path / "map.yaml").write_text(head + tiles + wall)
    picture = tmp_path / "map.png"
    assert main(["scenes", "show", str(tmp_path / "map.yaml"), "--picture", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    shown = capsys.readouterr().out
    assert "floors       2" in shown
    assert "walkable_m2 3" in shown
    assert "palms_m2 6" in shown
    assert shown.count("note         ") == 3
    assert main(["scenes", "list", "--picture", str(picture)]) == 2
    assert "--picture: goes with scenes show" in one_line(capsys)
