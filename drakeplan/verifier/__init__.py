"""Decides whether a plan file holds, from the file and the robot's model alone.

It shares no code with what made the plan: it imports NumPy, SciPy, h5py, yaml, shapely and pydrake, and a test holds it to that.
Imports inside it are relative, so that the folder can be copied anywhere and run by itself (`python -m verifier PLAN.h5`).

Every check names its worst value, its limit and the place. The plan holds when every check does. A plan of contacts alone
(status "contacts") is checked as far as it goes and does not hold.

Symbols: M mass of the robot, g = 9.81 m/s^2, W world, C a contact's frame with z along the normal n, f a contact's force,
tau its torque about n; knot n at t[n] with CoM c, linear momentum l, angular momentum k about the CoM; frame i at t[i] with
positions q and velocities v. #(...) counts rows. All values are the worst of their kind, unless they say RMS.

| check | equation | limit | why that limit |
|---|---|---|---|
| complete | status is "complete" | 0 | without motion and forces it cannot be carried out |
| numbers finite | #(NaN or infinite) | 0 | nothing can be computed with them |
| nothing empty | rows that are missing | 0 | one contact, stance and phase, two knots and frames are the least |
| indices in range | #(index of no row) | 0 | an index names a row |
| time runs forward | #(dt <= 0) of knots, frames, phases | 0 | rates divide by dt |
| knot spacing | t[n+1] - t[n] | 0.2001 s | forces are constant in between; the planner's longest step is 0.2 s |
| frame spacing | t[i+1] - t[i] | 0.0201 s | 50 Hz: what lies between frames is not looked at |
| contact pose | X_WC off a rigid transform: R^T R - 1, det R - 1, last row | 1e-6 | rounding |
| patch size | 1 mm - half extents | 0 m | a patch has an area |
| support in patch | corner of the support outside the patch; infinite if not convex | 1e-6 m | rounding |
| contact surface exists | #(index of no surface) | 0 | an index names a surface |
| contact allowed | #(surface not for this end effector) | 0 | the scene says who may touch a surface, else its tilt |
| contact friction | mu over the least mu of the surfaces under the support, or off their one mu | 1e-9 | the same number twice |
| contact on surface | (p_WC - p_WS) . n_S, unless it lies on edges | 1e-3 m | far above rounding, below what a sole's rubber gives |
| contact normal | angle of n to n_S, unless it lies on edges | 1e-3 rad | 0.1 mm over half a sole |
| support on terrain | corner of the support off a face that is turned from it by | 3e-3 m | surfaces closer than this are one floor |
|  | at most 1 deg, or off an edge, of surfaces for this end effector |  |  |
| support size | 1 cm - inner radius of a support that is not the whole patch | 0 m | a sole rolls over a smaller one |
| patch uncovered | height of surfaces and obstacles over the patch | 3e-3 m | surfaces closer than this are one floor |
| patch on robot | corner of the patch to the body's collision shape | 0.01 m | shapes are simplified; a larger sole carries more |
| stance effectors | #(contact of another end effector) | 0 | columns of the table are end effectors |
| one change a stance | #(changes from stance to stance) - 1 | 0 | the format's definition of a sequence |
| stance holds | #(stance without contact) | 0 | something carries the robot |
| phases contiguous | start of a phase - end of the one before | 1e-6 s | rounding |
| one time span | ends of phases, knots and frames apart | 1e-6 s | rounding |
| phase effectors | #(contact of another end effector) | 0 | columns of the table are end effectors |
| phase holds | #(phase without contact) | 0 | something carries the robot |
| phases follow stances | #(phase other than both stances, or what they share) | 0 | the moving end effector carries nothing |
| phases agree with forces | #(knot with other contacts than its phase) | 0 | two tables of one fact |
| no force without contact | abs(f), abs(tau) where nothing is held | 1e-9 M g | rounding |
| last row repeats | last row of contacts and forces - the one before | 1e-9 | nothing acts after the last knot |
| unilateral | -f . n | 1e-9 M g | rounding: contacts push |
| wrench in true cone | l1 distance from forces at the corners, abs(f_t) <= mu f . n | 1e-6 M g | tolerance of the linear program |
| wrench in named cone | the same with the cone that the plan names | 1e-6 M g | tolerance of the linear program |
| wrench within the reserve | in the true cone, with the shares of mu and supports | 1e-6 M g | tolerance of the linear program |
|  | that the provenance names, if any |  |  |
| mass | M of the file / M of the model - 1 | 1e-6 | rounding |
| newton | (l[n+1] - l[n]) / dt - sum f - M g | 1e-6 M g | the planner's own equation: rounding |
| com integration | c[n+1] - c[n] - dt l[n+1] / M | 1e-6 m | the planner's own equation: rounding |
| euler | (k[n+1] - k[n]) / dt - sum (p - c[n+1]) x f + tau n | 1e-6 M g m | the planner's own equation: rounding |
| momentum at rest | l / M, k / M at the start and the end | 1e-3 m/s | tolerance of the momentum program |
| balance at rest | l1 distance of M g from what first and last contacts carry | 1e-4 M g | a 32-gon stands for the round cone |
| quaternion unit | norm of q[0:4] - 1 | 1e-6 | rounding |
| quaternion sign | - q[i+1] . q[i] of the quaternions | 0 | else interpolation turns the long way round |
| joint limits | q past its limits | 1e-4 rad | tolerance of the posture program |
| joint speeds | v and d past their limits, d = (q[i+1] - q[i]) / dt | 1e-3 rad/s | tolerance of the motion program |
| velocities | d outside v[i] to v[i+1], or v off (d[i-1] + d[i]) / 2: the lesser | 0.1 rad/s | acceleration changes by 60 rad/s^2 |
|  | both are dt / 12 times the change of acceleration across them |  | in a frame |
| joint accelerations | (v[i+1] - v[i]) / dt of joints | 150 rad/s^2 | today 94 (wider_gap), 62 elsewhere; target 60 |
| posture at rest | v at the start and the end | 1e-3 rad/s | rounding |
| held contacts stay | end effector's frame to p_WC | 5e-3 m | the format's tolerance for held contacts |
| held contacts keep level | angle of the end effector's frame to X_WC | 1 deg | the format's tolerance for held contacts |
| com of model | CoM of the model - c(t) | 0.02 m | a fifth of half a sole's length; c(t) itself is linear between knots |
| linear momentum of model | l of the model - l(t) | 36 kg m/s | today 26.5 (wider_gap), 9 elsewhere; target 6 |
| linear momentum of model, RMS | root mean square over all frames | 7 kg m/s | today 5.7 (wider_gap), 3.1 elsewhere; target 2 |
| angular momentum of model | k of the model - k(t) | 10 N m s | today 6.6 (wider_gap), 4.2 elsewhere; target 6 |
| angular momentum of model, RMS | root mean square over all frames | 2.5 N m s | today 2.3 (wider_gap), 1.2 elsewhere; target 2 |
| angular momentum of model, median | median over all frames | 1 N m s | today 1.0 (wider_gap); limbs that swing all the time |
| joint torques | abs(M vdot + C v - tau_g - sum J^T F) / actuator's limit | 2.5 | today 2.1 (jvrc1), 1.2 (others); target 1 |
| stored torques | tau of the file, where it has any, to that of the model | 1e-6 N m | rounding, through another library |
| self collision | depth of penetration | 5e-3 m | collision shapes are simplified |
| terrain collision | depth of penetration | 5e-3 m | collision shapes and the terrain are simplified |
| sole and palm collision | depth of penetration | 0.01 m | a held contact may be 5 mm and 1 deg off besides |
| start | mean of the feet to the scene's start; a given stance within 1 mm | 0.15 m | set-down tries places up to 0.14 m away |
| start height | mean height of the feet to the scene's start; not for a given stance | 0.15 m | the planner writes that height |
| start heading | mean heading to the scene's start; a given stance within 1e-3 rad | 5 deg | headings are projected on tilted ground |
| goal | mean of the feet to the scene's goal | the scene's radius | the scene says so |
| goal height | mean height of the feet to the scene's goal | 0.5 m | uneven ground; another floor is further |
| goal heading | mean heading to the scene's goal | 15 deg | half a cell of the planner's grid of headings |

"today" is the worst that `drakeplan bench verifier` and other seeds of its scenes gave; the limit adds a little room, so that
no plan of today is refused. Targets are not enforced yet.
"""

from .plan_file import UnreadablePlan as UnreadablePlan
from .report import Check as Check
from .report import Report as Report
from .verification import verify as verify
