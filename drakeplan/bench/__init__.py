"""Benchmarks: every performance figure that README.md and docs state has a command here.

Each name is a module of this package with `run(options: BenchOptions)`, which returns a `BenchTable` or a tuple of them.
"""

BENCHES = {
    "first": "time to the first contact sequence, rubble field and corridor, one thread",
    "footholds": "first contact sequences where steps move to the nearest foothold, beside fixed steps",
    "bars": "foot placements on two bars, sampled and between edges, by gap (Grey 2017 fig. 4.10); picture in out/",
    "scenes": "verdicts of the verifier for every named scene and the meshes of hpp-environments",
    "verifier": "how close motions come to the verifier's limits on momenta, accelerations and torques",
    "command": "whole command from process start to files written: time and memory",
    "maps": "large floors and fine maps: time and memory of planning and verifying",
    "meshes": "every mesh of hpp-environments, one start and goal each: status, reason, time, memory",
    "execution": "plans played in physics: how many arrive, how near to the plan, what gave way",
    "reserve": "what a reserve of friction and supports costs the planner and buys in physics",
    "scale": "growth with the number of surfaces and with the distance",
    "published": "the published draws of the rubble scenes (needs DRAKEPLAN_CASES)",
    "balance": "balance polygons and queries against hpp-centroidal-dynamics and HiGHS",
    "experience": "stored plans adapted, the search, and both at once; success where footholds get rare; picture in out/",
    "segments": "rooms joined by corridors and staircases: search, segments of a guiding path, stored plans",
    "traversability": "learned estimates of how hard ground is, as a heuristic: three corridors, regressors, features",
    "robots": "robots of other people, added from their models: checked, and sent across four scenes",
    "robustness": "plans against pushes: every push tried, beside Lin 2020 fig. 7.7",
    "braced_ramp": "a wheeled robot that walks along a wall with its palms: standard heuristic beside traversability",
    "deform": "plans deformed to surfaces moved by up to 10 cm and 15 deg, beside planning again",
    "surrogate": "learned centroidal dynamics: errors on scenes held out (Lin 2020 fig. 6.10) and time a transition",
    "centroidal": "centroidal labels per second, agreement with an interior point, whole sequences, crocoddyl",
    "kinodynamic": "momenta of the played motion less the dynamics, after each iteration and without the feedback",
    "capture": "zero- and one-step capture: acceptance, time, agreement with the linear inverted pendulum",
    "optimizers": "formulations and solvers side by side: success, cost, violation, time, memory; picture in out/",
    "planners": "search, mixed-integer programs and graph of convex sets: same scenes, seeds, verifier; picture in out/",
    "mixed_integer": "contacts by mixed-integer programs on 14 surfaces: 12, 18, 24 contacts, every solver at hand",
    "momentumopt": "the centroidal program against published solutions (--case FILE, or needs DRAKEPLAN_CASES)",
    "campaign": "label campaigns: labels per second on one worker and on two, and after a stop half way",
    "lin2019": "the experiments of Lin et al. 2019, mixed-integer baselines, ablation; pictures in out/",
    "crossings": "gaps and slopes that need motion: planned, made into a motion, verified; strides; speeds",
}
