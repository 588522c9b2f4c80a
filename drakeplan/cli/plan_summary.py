"""What `drakeplan plan` prints about its result: a few lines for people."""

from __future__ import annotations


def summary(report: dict[str, object]) -> str:
    """The report of `--json` for people.

    Args:
        report: of a query that found contacts.
    """

    def number(key: str, form: str = ".2f") -> str:
        value = report.get(key)
        return "-" if value is None else format(value, form)

    verified = report["verified"]
    state = "complete, verified" if report["status"] == "complete" else "contacts only"
    if isinstance(verified, dict) and verified.get("failed"):
        state += f", verification failed: {', '.join(verified['failed'])}"
    lines = [
        f"{report['scene']}, {report['robot']}, seed {report['seed']}: {state}",
        f"  {report['stances']} stances, {report['contacts']} contacts, {report['palms_used']} with a palm;"
        f" cost {number('cost', '.3f')}, bound {number('bound', '.3f')}",
        f"  first contacts {number('time_to_first_s', '.3f')} s, first feasible {number('time_to_first_feasible_s')} s;"
        f" search {number('planning_s')} s, dynamics {number('dynamics_s')} s, motion {number('motion_s')} s",
        *_guide(report),
        *_origin(report),
        *_pushes(report),
        *_judges(report),
        *_torque(report),
        *_simulated(report),
        f"  total {number('total_s')} s, {number('peak_rss_mb', '.0f')} MB",
    ]
    files = report["files"]
    if isinstance(files, dict):
        lines += [f"  {kind:<4}  {path}" for kind, path in files.items()]
    return "\n".join(lines)


def _guide(report: dict[str, object]) -> list[str]:
    """A line with the segments of the guiding path that it follows, if any."""
    told = report.get("guide")
    if not isinstance(told, list) or not told:
        return []
    words = [f"{s['mode'].replace('_', ' ')} {'adapted' if s['method'] == 'adapt' else 'searched'}" for s in told]
    return [f"  along a guiding path of {len(told)} segment{'s' if len(told) > 1 else ''}: {', '.join(words)}"]


def _origin(report: dict[str, object]) -> list[str]:
    """A line with the stored plans that it was adapted from, if any."""
    names = report.get("adapted_from")
    if not isinstance(names, list) or not names:
        return []
    return [f"  adapted from the stored plan{'s' if len(names) > 1 else ''} {', '.join(map(str, names))}"]


def _pushes(report: dict[str, object]) -> list[str]:
    """A line with the probability of arriving under pushes, where the search asked for it."""
    success = report.get("predicted_success")
    if not isinstance(success, float):
        return []
    return [
        f"  {100 * success:.1f} % likely to arrive under pushes, as the networks see it; drakeplan robustness tries them"
    ]


def _judges(report: dict[str, object]) -> list[str]:
    """A line with the number of transitions whose dynamics were evaluated by networks and by the program, if any."""
    asked = report.get("transitions_judged")
    if not isinstance(asked, dict) or not any(asked.values()):
        return []
    learned, exact = int(asked.get("learned", 0)), int(asked.get("exact", 0))
    return [f"  {learned + exact} transitions judged: {learned} by network, {exact} by exact program"]


def _torque(report: dict[str, object]) -> list[str]:
    """A line with the greatest joint torque, where there is a motion."""
    torque = report.get("torque")
    if not isinstance(torque, dict):
        return []
    share, beyond = 100 * float(torque["share"]), " (more than it can)" if torque["share"] > 1.0 else ""
    return [f"  torques up to {share:.0f} % of a joint's limit: {torque['joint']} at {torque['time']:.2f} s{beyond}"]


def _simulated(report: dict[str, object]) -> list[str]:
    """A line with what came of the plan in physics, where it was played."""
    played = report.get("simulated")
    if not isinstance(played, dict):
        return []
    state = "the robot stands at the goal" if played["reached"] else played["reason"]
    return [f"  in physics {state}; CoM at most {1e3 * float(played['com_error_m']):.0f} mm from the plan"]
