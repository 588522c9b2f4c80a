"""Two plans on one page: what both draw alike stands in it once, in the order that each needs."""

from __future__ import annotations

import dataclasses
import json
import re
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from drakeplan import playback
from drakeplan.cli import main
from drakeplan.plan.plan import Plan
from drakeplan.plan.plan_file import write_plan
from drakeplan.playback.beside import joined
from drakeplan.playback.server import PageServer
from scenes.input_error import InputError


def meshcat_page(*messages: str, assets: str = "") -> str:
    """A page like Drake's, with these messages in base64."""
    fetches = "\n".join(
        f'fetch("data:application/octet-binary;base64,{m}")\n    .then(res => res.arrayBuffer())\n'
        "    .then(buffer => viewer.handle_command_bytearray(new Uint8Array(buffer)));\n"
        for m in messages
    )
    return f"<html><body><script>before();\n{assets}\n{fetches}</script>after</body></html>"


def loaded(page: str) -> tuple[list[list[str]], list[str]]:
    """The messages of each view in its order, and all that the page holds."""
    messages = json.loads(re.findall(r"const messages = (\[.*?\])\.map", page)[0])
    orders = json.loads(re.findall(r"(\[\[.*?\]\])\.forEach", page)[0])
    return [[messages[m] for m in order] for order in orders], messages


def test_each_view_gets_its_own_messages_in_order_and_equal_ones_are_there_once() -> None:
    first, second = ["AAAA", "BBBB", "CCCC", "BBBB"], ["BBBB", "DDDD", "AAAA"]
    page = joined(meshcat_page(*first), meshcat_page(*second))
    orders, messages = loaded(page)
    assert orders == [first, second]
    assert sorted(messages) == ["AAAA", "BBBB", "CCCC", "DDDD"]
    assert "fetch(" not in page
    assert page.startswith("<html><body><script>before();")
    assert page.endswith("</script>after</body></html>")


def test_textures_of_both_are_there_once() -> None:
    one, two = (f'casAssets["{n}"] = "data:application/octet-binary;base64,{n}";' for n in ("k1", "k2"))
    page = joined(meshcat_page("AAAA", assets=one), meshcat_page("BBBB", assets=f"{one}\n{two}"))
    assert (page.count(one), page.count(two)) == (1, 1)


def test_a_page_of_another_form_is_a_defect_that_is_said() -> None:
    strange = meshcat_page("AAAA").replace("res.arrayBuffer()", "res.bytes()")
    for pages in ((strange, meshcat_page("AAAA")), (meshcat_page("AAAA"), strange), ("", "")):
        with pytest.raises(RuntimeError, match="unknown form"):
            joined(*pages)


@pytest.fixture(scope="module")
def both(strolling_plan: Plan) -> str:
    contacts = dataclasses.replace(strolling_plan, phases=None, centroidal=None, motion=None)
    return playback.beside_page_html((strolling_plan, contacts), ("a/plan.h5", "b/<later>.h5"))


def test_one_time_bar_drives_two_plans_that_are_named(both: str) -> None:
    assert both.count('<input type="range"') == 1
    assert both.count('class="plan-pane"') == 2
    assert "<b>plan.h5</b>" in both
    assert "<b>&lt;later&gt;.h5</b>" in both
    data = json.loads(re.findall(r'id="plan-data" type="application/json">(.*?)</script>', both)[0])
    assert [plan["timed"] for plan in data["plans"]] == [True, False]
    assert data["linked"] is True


def test_the_same_robot_weighs_once(strolling_plan: Plan) -> None:
    one = playback.page_html(strolling_plan)
    twice = playback.beside_page_html((strolling_plan, strolling_plan), ("a", "b"))
    assert len(twice) < 1.02 * len(one)


def test_the_same_plans_give_the_same_page(both: str, strolling_plan: Plan) -> None:
    contacts = dataclasses.replace(strolling_plan, phases=None, centroidal=None, motion=None)
    assert playback.beside_page_html((strolling_plan, contacts), ("a/plan.h5", "b/<later>.h5")) == both


def test_plans_of_one_name_are_told_apart_by_their_folders(strolling_plan: Plan) -> None:
    page = playback.beside_page_html((strolling_plan, strolling_plan), ("old/plan.h5", "new/plan.h5"))
    assert "<b>old/plan.h5</b>" in page
    assert "<b>new/plan.h5</b>" in page


# ---- the command and its server


def test_play_beside_writes_one_page(strolling_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, second, page = tmp_path / "a b.h5", tmp_path / "über.h5", tmp_path / "both.html"
    write_plan(strolling_plan, first)
    write_plan(dataclasses.replace(strolling_plan, phases=None, centroidal=None, motion=None), second)
    assert main(["play", str(first), "--beside", str(second), "--html", str(page), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["plan"], said["beside"], said["html"], said["url"]) == (str(first), str(second), str(page), None)
    assert "über.h5" in page.read_text(encoding="utf-8")


def test_play_beside_a_file_that_is_not_there_names_it_and_writes_nothing(
    strolling_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_plan(strolling_plan, tmp_path / "a.h5")
    assert (
        main(["play", str(tmp_path / "a.h5"), "--beside", str(tmp_path / "no.h5"), "--html", str(tmp_path / "p.html")])
        == 2
    )
    assert "no.h5" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5"]


def test_the_server_gives_the_page_and_nothing_else_to_this_machine_alone() -> None:
    server = PageServer("<p>größer</p>")
    try:
        with urllib.request.urlopen(server.url, timeout=10) as answer:
            assert answer.read().decode() == "<p>größer</p>"
            assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
        for path in ("/../../etc/passwd", "/plan.h5"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(server.url + path, timeout=10)
        port = int(server.url.rpartition(":")[2])
        table = Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]
        places = [row.split()[1] for row in table if row.split()[3] == "0A"]
        assert f"0100007F:{port:04X}" in places  # 127.0.0.1
        assert f"00000000:{port:04X}" not in places
        with pytest.raises(InputError, match=f"port {port}"):
            PageServer("", port)
    finally:
        server.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(server.url, timeout=10)
