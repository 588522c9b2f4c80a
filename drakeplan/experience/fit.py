"""The contacts of one motion fitted to a terrain: a region for each, an elastic strip, and other regions where that breaks.

    contacts -> nearest contact regions -> elastic strip -> contacts that hold
        ^                                       |
        +---- penalties for where it breaks ----+

Each contact goes to the circle nearest to it by the distance of Lin 2020 eq. 4.4; the elastic strip moves contacts and
configurations together until limits, contact, balance and clearance hold (sec. 4.5.3). A place that breaks counts as further
away from then on, until a contact goes elsewhere.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from drakeplan.context import QueryContext
from drakeplan.experience.key_motion import KeyMotion
from drakeplan.experience.strip_setup import Choice, Sampling, contact_choices, make_problem, settle
from drakeplan.experience.terrain_regions import TerrainRegions
from optimization.balance.friction import FrictionCone
from optimization.elastic_strip.problem import CONTACT, Gathering, StripEstimate, StripOptions
from optimization.elastic_strip.program import ElasticStrip
from scenes.contact import Contact
from scenes.footholds.contact_regions import ContactRegions
from scenes.stance import Stance

PENALTY, MAX_PENALTIES = 0.04, 12  # [m] added to the distance of a region that failed, and how often for one repair
MAX_PULLS = 8  # times that the last feet are moved towards the goal
BYSTANDER = 0.4  # share of the penalty for contacts that are held where another contact, or the CoM, is at fault


class Fit:
    """One motion on one terrain, with what was learnt so far about where its contacts cannot go.

    Attributes:
        motion: what is fitted.
        problem: why a contact has nowhere to go, "" if each has a place.
        strip: the last elastic strip, None before.
    """

    def __init__(
        self,
        motion: KeyMotion,
        context: QueryContext,
        sampling: Sampling,
        options: StripOptions,
        *,
        gatherings: tuple[Gathering, ...] = (),
        fixed: Mapping[int, Contact] | None = None,
        balanced: bool = True,
        terrain: TerrainRegions | None = None,
    ) -> None:
        """Finds the regions that each contact may go to.

        Args:
            motion: what is fitted, where it is before its contacts move.
            context: terrain, robot and cone.
            sampling: how far contacts may be sent.
            options: of the elastic strip; its cone is the context's, whatever is said here.
            gatherings: places that groups of contacts must be near.
            fixed: contacts that have to be where they are already, by index.
            balanced: whether the strip is asked for balance.
            terrain: regions that several fits share; None finds each contact's own, exact for its heading.
        """
        self.motion, self.context, self._sampling = motion, context, sampling
        self._options = replace(options, cone=context.cone)
        self._gatherings, self._balanced, self._terrain = gatherings, balanced, terrain
        self._fixed = dict(fixed or {})
        self._penalty: list[dict[int, float]] = [{} for _ in motion.contacts]
        self._tried: set[tuple[int, ...]] = set()
        self.strip: StripEstimate | None = None
        self.problem = ""
        self._regions = self._find_regions()
        pairs = zip(motion.contacts, self._regions, strict=False)
        self._distance = [regions.distance(contact.X_WC) for contact, regions in pairs]
        self._settled: dict[tuple[int, int], Choice] = {}
        self._chosen = [] if self.problem else self._choose()

    def project(self) -> list[Stance] | None:
        """The contact sequence with every contact at the nearest point of its region, without a strip.

        The last feet are moved within their regions until the gatherings hold; None where they do not.
        """
        self._tried.add(_places(self._chosen))
        contacts = [contact for contact, _ in self._chosen]
        for gathering in self._gatherings:
            for _ in range(MAX_PULLS):
                mean = np.mean([contacts[c].p_WC[:2] for c in gathering.contacts], axis=0)
                short = _short_of(gathering, mean)
                if not short.any():
                    break
                for c in gathering.contacts:
                    if c not in self._fixed:
                        contacts[c] = _pulled(contacts[c], self._chosen[c][1], short)
            else:
                return None
        return self._sequence(contacts)

    def leave_gatherings(self) -> bool:
        """Sends the contacts that must be near a place and are not to other surfaces; False where nothing is left to try."""
        blamed = {c: 1.0 for gathering in self._gatherings for c in gathering.contacts if c not in self._fixed}
        return self._choose_again(blamed)

    def solve(self, seconds: float) -> StripEstimate:
        """Deforms the strip towards the regions chosen now.

        Args:
            seconds: of processor time at most.
        """
        self._tried.add(_places(self._chosen))
        problem = make_problem(self.motion, self._chosen, self._gatherings, balanced=self._balanced)
        self._held = problem.held
        options = replace(self._options, time_limit=min(self._options.time_limit, seconds))
        model = self.context.ik.model
        kinematics, packed = self.context.ik.kinematics, self.context.packed
        self.strip = ElasticStrip(self.context.robot, kinematics, model.capsules, packed, problem, options).solve()
        return self.strip

    def stances(self) -> list[Stance]:
        """The contact sequence that the last strip came to."""
        assert self.strip is not None
        return self._sequence([self._fixed.get(c, contact) for c, contact in enumerate(self.strip.contacts)])

    def moved(self) -> np.ndarray:
        """(C,) how far the last strip's contacts are from where they were [m]."""
        assert self.strip is not None
        pairs = zip(self.strip.contacts, self.motion.contacts, strict=True)
        return np.array([np.linalg.norm(a.p_WC - b.p_WC) for a, b in pairs])

    def leave_broken_places(self) -> bool:
        """Sends the contacts at which the last strip breaks elsewhere; False where nothing else is left to try."""
        return self._choose_again(self._blame_strip())

    def leave_transitions(self, transitions: Sequence[int]) -> bool:
        """Sends the contacts of transitions that a later step refused elsewhere; False as above.

        Args:
            transitions: k, from stance k to stance k + 1.
        """
        return self._choose_again(self._blame_transitions(transitions))

    def _sequence(self, contacts: Sequence[Contact]) -> list[Stance]:
        return [Stance(tuple(contacts[c] if c >= 0 else None for c in row)) for row in self.motion.stances]

    # Regions ---------------------------------------------------------------------------------------------------------

    def _find_regions(self) -> list[ContactRegions]:
        """The circles that each contact may go to; stops at the first contact that has none."""
        began, alone, found = time.process_time(), self.motion.carries_alone(), []
        for c, contact in enumerate(self.motion.contacts):
            if c in self._fixed:
                found.append(_only(self._fixed[c]))
                continue
            cone = self.context.cone if alone[c] else None
            found.append(self._choices(contact, cone))
            if not len(found[c]):
                what = "no contact region flat enough to stand on alone" if alone[c] else "no contact region"
                where = f"within {self._sampling.furthest:g} m of where it was"
                self.problem = f"contact {c} ({contact.effector}): {what} {where}"
                break
        self.regions_s = time.process_time() - began
        return found

    def _choices(self, contact: Contact, cone: FrictionCone | None) -> ContactRegions:
        if self._terrain is not None:
            return self._terrain.near(contact, self._sampling.furthest, cone)
        return contact_choices(contact, self.context.robot, self.context.packed, self._sampling, cone)

    def _choose(self) -> list[Choice]:
        """The region of each contact: the nearest, with penalties added for regions that failed before."""
        return [self._settle(c) for c in range(len(self.motion.contacts))]

    def _settle(self, c: int) -> Choice:
        if c in self._fixed:
            return self._fixed[c], self._regions[c]
        regions, distance = self._regions[c], self._distance[c]
        if self._penalty[c]:
            distance = distance + np.array([self._penalty[c].get(int(k), 0.0) for k in regions.surface])
        surface = int(regions.surface[np.argmin(distance)])
        if (c, surface) not in self._settled:
            self._settled[c, surface] = settle(self.motion.contacts[c], regions, self.context.packed, surface)
        return self._settled[c, surface]

    def _choose_again(self, blamed: Mapping[int, float]) -> bool:
        """Other regions: the penalties of the contacts at fault grow until the choice changes."""
        chosen = self._chosen
        for _ in range(MAX_PENALTIES if blamed else 0):
            for c, share in blamed.items():
                surface = chosen[c][0].surface
                self._penalty[c][surface] = self._penalty[c].get(surface, 0.0) + share * PENALTY
            chosen = self._choose()
            if _places(chosen) not in self._tried:
                self._chosen = chosen
                return True
        return False

    # Who is at fault -------------------------------------------------------------------------------------------------

    def _blame_strip(self) -> dict[int, float]:
        """Contacts at which the strip fails, with their shares of the fault: contacts missed, and those held there."""
        assert self.strip is not None
        blamed: dict[int, float] = {}
        worst = self.strip.faults[0].value / self.strip.faults[0].limit
        for fault in self.strip.faults:
            weight = fault.value / fault.limit / worst
            if fault.task == CONTACT:
                blamed[fault.contact] = max(blamed.get(fault.contact, 0.0), weight)
            for c in self._held[fault.configuration] if fault.configuration >= 0 else ():
                if c >= 0:
                    blamed[int(c)] = max(blamed.get(int(c), 0.0), BYSTANDER * weight)
        return blamed

    def _blame_transitions(self, transitions: Sequence[int]) -> dict[int, float]:
        """The contact that a transition makes, or the last one made before; the others held there less."""
        blamed: dict[int, float] = {}
        table = self.motion.stances
        for transition in transitions:
            k = min(transition, len(table) - 2)
            for c in table[k : k + 2].ravel():
                if c >= 0:
                    blamed[int(c)] = max(blamed.get(int(c), 0.0), BYSTANDER)
            while k >= 0:
                new = table[k + 1][(table[k + 1] >= 0) & (table[k + 1] != table[k])]
                if len(new):
                    blamed[int(new[0])] = 1.0
                    break
                k -= 1
        return blamed


def _places(chosen: Sequence[Choice]) -> tuple[int, ...]:
    return tuple(contact.surface for contact, _ in chosen)


def _short_of(gathering: Gathering, mean: np.ndarray) -> np.ndarray:
    """(2,) the way from the mean of a gathering's contacts into its circle; zero inside [m]."""
    ahead = np.array(gathering.xy) - mean
    length = float(np.hypot(*ahead))
    return ahead * (1.0 - 0.95 * gathering.radius / length) if length > gathering.radius else np.zeros(2)


def _pulled(contact: Contact, regions: ContactRegions, pull: np.ndarray) -> Contact:
    """The contact moved horizontally, as far as its regions allow.

    Args:
        contact: where it is now.
        regions: of its surface.
        pull: (2,) [m].
    """
    X_WC = contact.X_WC.copy()
    X_WC[:2, 3] += pull
    X_WC[:3, 3] = regions.project(X_WC, regions.nearest(X_WC)[0])[:3, 3]
    return replace(contact, X_WC=X_WC)


def _only(contact: Contact) -> ContactRegions:
    """The one place of a contact that may not move."""
    return ContactRegions(np.array([contact.surface]), contact.X_WC[None], np.zeros(1))
