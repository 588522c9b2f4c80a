"""Fig. 8 of Lin et al. 2019 (Lin 2020 fig. 6.9): what comes of the queries, columns (1) to (12)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drakeplan.bench.lin2019.queries import DEADLINE, MAIN, SCENES, SHORT, Query, mean, of
from drakeplan.bench.momentum_columns import COLUMNS, pooled_means
from drakeplan.bench.table import BenchTable

# Lin et al. 2019 fig. 8, columns (1) to (12).
PUBLISHED = {
    ("rubble_field", "quasi-static"): ("47/50", "47/47", 1.17, 3498.5, 12.0, 12.7, 0.472, 0.706, 0.767, 0.012, 0.062, 0.0068),
    ("rubble_field", "learned"): ("50/50", "50/50", 1.02, 3334.2, 6.00, 9.68, 0.581, 0.559, 0.763, 0.010, 0.079, 0.0079),
    ("rubble_corridor", "quasi-static"): ("44/50", "44/44", 1.05, 3418.7, 11.5, 11.16, 0.523, 0.618, 0.768, 0.013, 0.082, 0.0069),
    ("rubble_corridor", "learned"): ("50/50", "49/50", 1.59, 2392.5, 4.38, 4.83, 1.378, 0.349, 0.631, 0.025, 0.088, 0.0173),
}  # fmt: skip
NOTES = (
    "(3) sequences whose whole program was solved, from the last to the first, until one was feasible; (4) its objective; (5) to "
    "(12) means over all time steps of all feasible trials, (9) of the root mean square over the contacts of a time step, (10) to "
    "(12) over its contacts, (11) in the contact's frame. With palms: sequences that make a palm contact.",
    "Published rows: Lin et al. 2019 fig. 8: another robot (30 joints, soles 22 cm long; mass, width of soles and reaches are not "
    "given), other draws of the surfaces, IPOPT. Definitions, timing and weights are the same; (5) to (8) hang on mass and stride, "
    "(12) on the patches (ours 22 x 10 cm and 9 x 9 cm: at most 5 and 4.5 cm).",
    f"Search: {SHORT:g} s, or until the first sequence (documents: 30 s), {DEADLINE:g} s at most.",
)


def table(queries: Sequence[Query]) -> BenchTable:
    """Ours and the published row of each planner, one below the other."""
    rows = []
    for scene in SCENES:
        for planner in MAIN:
            answers = [q.answer for q in of(queries, scene, planner)]
            feasible = [a for a in answers if a.feasible]
            found = sum(a.found > 0 for a in answers)
            rows.append(
                (
                    scene, planner, f"{found}/{len(answers)}", f"{len(feasible)}/{found}", mean([a.tested for a in feasible]),
                    mean([a.objective for a in feasible]),
                    *pooled_means(np.array([a.robustness for a in feasible]).reshape(-1, 2, len(COLUMNS))),
                    f"{sum(a.palms for a in feasible)}/{len(feasible)}", mean([a.transitions for a in feasible]),
                )
            )  # fmt: skip
            rows.append((scene, f"{planner}, published", *PUBLISHED[scene, planner], "", ""))
    columns = ("scene", "planner", "(1) found", "(2) feasible", "(3) tested", "(4) objective", *COLUMNS, "with palms",
               "transitions")  # fmt: skip
    title = "Contact sequences with learned dynamics (Lin et al. 2019 fig. 8)"
    return BenchTable("lin2019", title, columns, tuple(rows), NOTES, most_seeds=None)
