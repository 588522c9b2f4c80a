"""`drakeplan robustness` and `drakeplan plan --capture`: what they say and write, that they go on, and their mistakes."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drakeplan.campaigns import push_trials
from drakeplan.campaigns import workers as campaign_workers
from drakeplan.campaigns.campaign import Campaign, Task, run_task
from drakeplan.campaigns.engine import CollectOptions, collect
from drakeplan.campaigns.push_trials import PushTrialsCampaign, file_sha256, read_trials, region_of
from drakeplan.campaigns.workers import Outcome
from drakeplan.cli import main
from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import read_plan, write_plan
from drakeplan.robustness.moments import Moment, moments_of
from drakeplan.robustness.push_trial import FALLS, STANDS, Trial
from scenes.disturbance import Disturbance
from scenes.files.scene_file import scene_from_yaml, write_scene

SIDE = np.array([[0.0, 10.0, 0.0], [0.0, -10.0, 0.0]])
FEW = ["--samples", "1", "--pairs", "0.2", "--workers", "1"]


class HereWorkers:
    """Runs tasks in this process; stopped by Ctrl-C after so many."""

    num_workers = 1

    def __init__(self, campaign: Campaign, num_workers: int = 1, *, until: int = 1000) -> None:
        self.campaign, self.until, self.waiting, self.ended = campaign, until, [], []

    def submit(self, task: Task) -> None:
        self.waiting.append(task)

    def next_outcome(self, timeout: float) -> Outcome:
        if len(self.ended) == self.until:
            raise KeyboardInterrupt
        self.ended.append(self.waiting.pop(0))
        return Outcome(self.ended[-1], run_task(self.campaign, self.ended[-1]))

    def close(self) -> None:
        pass


class QuickTrials:
    """Stands in for `PushTrials`: every third moment falls, the others stand."""

    def __init__(self, *_: object) -> None:
        pass

    def ask(self, moment: Moment, impulse: np.ndarray) -> Trial:
        return Trial(FALLS, None, 4, "far off") if round(moment.t / 0.1) % 3 == 0 else Trial(STANDS, None, 1)


@pytest.fixture(scope="module")
def plan_path(stepping_plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plans") / "plan.h5"
    write_plan(stepping_plan, path)
    return path


@pytest.fixture(scope="module")
def pushed(stepping_plan: Plan, plan_path: Path) -> Path:
    """A scene file with pushes from both sides."""
    scene = scene_from_yaml(stepping_plan.scene_yaml, "the plan", mesh_triangles=stepping_plan.triangles)
    path = plan_path.with_name("pushed.yaml")
    write_scene(dataclasses.replace(scene, disturbances=(Disturbance(SIDE, 0.02),)), path)
    return path


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[HereWorkers]]:
    """Makes the command work in this process, with answers that take no time; returns those that will have worked."""
    monkeypatch.setattr(push_trials, "PushTrials", QuickTrials)

    def use(until: int = 1000) -> list[HereWorkers]:
        made: list[HereWorkers] = []

        def start(campaign: Campaign, num_workers: int, *, task_timeout: float) -> HereWorkers:
            made.append(HereWorkers(campaign, num_workers, until=until))
            return made[-1]

        monkeypatch.setattr(campaign_workers, "LocalWorkers", start)
        return made

    return use


def said(capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    return json.loads(capsys.readouterr().out)


def complaint(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of standard error that is no progress; standard output must be empty."""
    found = capsys.readouterr()
    lines = [line for line in found.err.splitlines() if not line.startswith("[")]
    assert found.out == "" and len(lines) == 1, found.err
    return lines[0]


# ---- what is said and written


def test_pushes_are_tried_told_and_written(
    plan_path: Path, pushed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, page, picture = tmp_path / "tried.h5", tmp_path / "tried.html", tmp_path / "map.png"
    files = ["--out", str(out), "--html", str(page), "--map", str(picture)]
    assert main(["robustness", str(plan_path), "--scene", str(pushed), *FEW, *files, "--json"]) == 0
    report = said(capsys)
    assert {"plan", "p_success", "interval", "pairs", "failed", "stood", "weakest", "swing", "files"} <= report.keys()
    assert report["files"] == {"plan": str(out), "html": str(page), "map": str(picture)}
    assert not list(tmp_path.glob("*.pushes-*")) and not list(plan_path.parent.glob("*.pushes-*"))
    assert picture.read_bytes().startswith(b"\x89PNG") and "likely to arrive" in page.read_text(encoding="utf-8")

    before, found = read_plan(plan_path), read_plan(out).robustness
    assert before.robustness is None and found is not None
    np.testing.assert_allclose(found.t, [m.t for m in moments_of(before)])
    np.testing.assert_allclose(np.sort(found.impulse, axis=0), np.sort(SIDE, axis=0))
    tried = found.captured >= 0
    assert tried.sum() == report["pairs"] and 10 < tried.sum() < 80
    np.testing.assert_allclose(found.probability[tried], 0.01)
    assert (found.captured == 0).sum() == report["failed"]
    low, high = report["interval"]  # type: ignore[misc]
    assert low <= found.p_success == report["p_success"] <= high
    method = json.loads(found.method)
    assert (method["samples"], method["pairs"], method["palms"]) == (1, 0.2, True)
    assert method["plan_sha256"] == file_sha256(plan_path)

    assert main(["verify", str(out), "--json"]) == 0
    assert said(capsys)["holds"]


def test_without_json_a_few_lines_say_it(
    plan_path: Path, pushed: Path, here: Callable, capsys: pytest.CaptureFixture[str]
) -> None:
    here()
    assert main(["robustness", str(plan_path), "--scene", str(pushed), *FEW]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:3]] == ["success", "pushes", "fell"]
    assert "95 % interval" in lines[0] and any(line.startswith("  weakest") for line in lines)


def test_a_plans_own_pushes_are_tried_and_a_tried_plan_may_be_tried_again(
    stepping_plan: Plan, pushed: Path, here: Callable, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here()
    path = tmp_path / "plan.h5"
    write_plan(dataclasses.replace(stepping_plan, scene_yaml=pushed.read_text(encoding="utf-8")), path)
    reports = []
    for _ in range(2):
        assert main(["robustness", str(path), *FEW, "--out", str(path), "--json"]) == 0
        reports.append(said(capsys))
        assert read_plan(path).robustness is not None
    assert reports[0] == reports[1]


def test_the_seed_draws_the_share_that_is_tried(
    plan_path: Path, pushed: Path, here: Callable, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here()
    tried = []
    for seed in ("0", "0", "1"):
        words = ["robustness", str(plan_path), "--scene", str(pushed), *FEW, "--seed", seed]
        assert main([*words, "--out", str(tmp_path / "tried.h5")]) == 0
        found = read_plan(tmp_path / "tried.h5").robustness
        assert found is not None
        tried.append(found.captured)
    np.testing.assert_array_equal(tried[0], tried[1])
    assert (tried[0] != tried[2]).any()


# ---- it goes on where it was stopped


def test_a_stopped_evaluation_goes_on_and_says_what_one_that_was_not_stopped_says(
    plan_path: Path, pushed: Path, here: Callable, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["robustness", str(plan_path), "--scene", str(pushed), *FEW, "--json"]
    (whole,) = [here()]
    assert main(words) == 0
    expected = said(capsys)
    assert expected["failed"] and expected["stood"]
    tasks = [task.number for task in whole[0].ended]
    assert len(tasks) == 20, "98 moments, five a task"

    here(until=7)
    assert main(words) not in (0, 2)
    (folder,) = plan_path.parent.glob("plan.h5.pushes-*")
    assert str(folder) in capsys.readouterr().err

    rest = here()
    assert main(words) == 0
    assert said(capsys) == expected
    assert sorted(task.number for task in rest[0].ended) == tasks[7:]
    assert not folder.exists()


def test_other_pushes_or_another_plan_do_not_go_on_with_what_was_left(
    plan_path: Path, pushed: Path, stepping_plan: Plan, here: Callable, tmp_path: Path
) -> None:
    out = ["--out", str(tmp_path / "tried.h5")]
    words = ["robustness", str(plan_path), "--scene", str(pushed), *out, *FEW]
    here(until=3)
    main(words)
    other = tmp_path / "other.h5"
    write_plan(dataclasses.replace(stepping_plan, provenance={"seed": 1}), other)
    for changed in ([*words, "--no-palms"], [*words, "--seed", "1"], ["robustness", str(other), *words[2:]]):
        made = here()
        assert main(changed) == 0
        assert len(made[0].ended) == 20
    assert len(list(tmp_path.glob("tried.h5.pushes-*"))) == 1, "what was left is still there"


def test_the_rows_of_a_campaign_are_those_of_every_task_and_moment(plan_path: Path, tmp_path: Path) -> None:
    """Every push at every moment of two tasks once, with the probability of the scene."""
    regions = (region_of(Disturbance(SIDE, 0.02)),)
    campaign = PushTrialsCampaign(str(plan_path), file_sha256(plan_path), "escher", regions, 0)
    assert campaign.num_tasks() == 20
    collect(campaign, tmp_path / "rows", CollectOptions(2, 0, 1), HereWorkers(campaign))
    rows = read_trials(tmp_path / "rows")
    assert sorted(zip(rows["moment"].tolist(), rows["impulse"][:, 1].tolist(), strict=True)) == [
        (moment, impulse) for moment in range(10) for impulse in (-10.0, 10.0)
    ]
    np.testing.assert_array_equal(rows["probability"], 0.01)
    np.testing.assert_array_equal(rows["asked"], 1)


def test_where_a_region_does_not_reach_nothing_is_tried(plan_path: Path, tmp_path: Path) -> None:
    X_WR = np.eye(4)
    X_WR[0, 3] = 10.0
    regions = (region_of(Disturbance(SIDE, 0.02, (1.0, 1.0, 4.0), X_WR)),)
    campaign = PushTrialsCampaign(str(plan_path), file_sha256(plan_path), "escher", regions, 0)
    assert list(campaign.rows(np.random.SeedSequence(0), 0)) == []


def test_a_mark_names_all_that_the_rows_depend_on(plan_path: Path) -> None:
    region = region_of(Disturbance(SIDE, 0.02))
    one = PushTrialsCampaign(str(plan_path), "a" * 64, "escher", (region,), 3)
    others = [
        dataclasses.replace(one, sha256="b" * 64),
        dataclasses.replace(one, disturbances=(region_of(Disturbance(SIDE, 0.03)),)),
        dataclasses.replace(one, samples=4),
        dataclasses.replace(one, pairs=0.5),
        dataclasses.replace(one, palms=False),
    ]
    marks = [one.mark(0), one.mark(1), *(other.mark(0) for other in others)]
    assert len(set(marks)) == len(marks)
    assert dataclasses.replace(one, plan="elsewhere.h5").mark(0) == one.mark(0)
    json.dumps(dict(one.parameters))


# ---- pushes given on the command line

PUSH = ["--impulse", "0", "10", "0"]


def test_a_push_may_be_given_on_the_command_line(
    plan_path: Path, here: Callable, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here()
    out = ["--out", str(tmp_path / "tried.h5"), "--json"]
    words = ["robustness", str(plan_path), *PUSH, "0", "-12", "0", "--probability", "0.04", *FEW, *out]
    assert main(words) == 0
    assert said(capsys)["pairs"]
    found = read_plan(tmp_path / "tried.h5").robustness
    assert found is not None
    np.testing.assert_allclose(found.impulse, [[0, -12, 0], [0, 10, 0]])
    np.testing.assert_allclose(found.probability[found.captured >= 0], 0.02)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--impulse", "nan", "0", "0"], "--impulse"),
        (["--impulse", "0", "1e9", "0"], "--impulse"),
        (["--impulse", "0", "10"], "--impulse"),
        ([*PUSH, "--probability", "2"], "--probability"),
    ],
)
def test_a_push_that_cannot_be_is_named(
    words: list[str], named: str, plan_path: Path, here: Callable, capsys: pytest.CaptureFixture[str]
) -> None:
    here(until=0)
    assert main(["robustness", str(plan_path), *words]) == 2
    assert named in complaint(capsys)


# ---- mistakes


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--pairs 0", "--pairs: expected a share above 0 and at most 1, got 0"),
        ("--pairs 2", "--pairs"),
        ("--pairs nan", "--pairs"),
        ("--samples -1", "--samples: expected 0 or more, got -1"),
        ("--samples 1.5", "--samples"),
        ("--workers 0", "--workers: expected 1 or more, got 0"),
        ("--seed -1", "--seed"),
        ("--probability 2", "--probability: expected 0 to 1, got 2"),
        ("--probability nan", "--probability"),
        ("--scene flatt", "did you mean flat"),
        ("--scene flat", "scene flat has no pushes"),
        ("--robot eshcer", "did you mean escher"),
        ("--out no/such/folder/plan.h5", "there is no folder"),
        ("--map no/such/folder/map.png", "there is no folder"),
        ("", "has no pushes: add `disturbances` to its file, or give --impulse"),
    ],
)
def test_a_mistake_gets_one_line_that_names_it_and_exit_2(
    words: str, named: str, plan_path: Path, here: Callable, capsys: pytest.CaptureFixture[str]
) -> None:
    here(until=0)
    assert main(["robustness", str(plan_path), *words.split()]) == 2
    assert named in complaint(capsys)


def test_a_plan_of_contacts_only_and_a_file_that_is_no_plan_are_refused(
    stepping_plan: Plan, pushed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_plan(dataclasses.replace(stepping_plan, phases=None, centroidal=None, motion=None), tmp_path / "contacts.h5")
    (tmp_path / "no.h5").write_text("no plan")
    for name, reason in (("contacts.h5", "contacts only"), ("no.h5", "not a plan"), ("nothing.h5", "no such plan")):
        assert main(["robustness", str(tmp_path / name), "--scene", str(pushed)]) == 2
        assert reason in complaint(capsys)


def test_two_outputs_with_one_name_are_refused(
    plan_path: Path, pushed: Path, here: Callable, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here()
    same = str(tmp_path / "same")
    words = ["robustness", str(plan_path), "--scene", str(pushed), *FEW, "--out", same, "--html", same]
    assert main(words) == 2
    assert "name the same file" in complaint(capsys)


# ---- planning against pushes


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("flat --capture swing", "it has none: add `disturbances` to the scene file"),
        ("narrow_flat --capture swing --planner guided", "needs --planner search"),
        ("narrow_flat --capture worst-case --dynamics quasi-static", "dynamics that move the CoM"),
        ("narrow_flat --capture swing --friction 0.4", "only for friction 0.5 and above, a surface has 0.4"),
        ("narrow_flat --capture swings", "did you mean swing"),
    ],
)
def test_planning_against_pushes_says_what_it_lacks(words: str, named: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", *words.split()]) == 2
    assert named in complaint(capsys)
