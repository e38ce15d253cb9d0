"""The paper's search of a frame: passes of torso, limbs and head until the energy stops falling."""

from services.mocap.energy.picture import Picture
from services.mocap.search.chains import HEAD, TORSO
from services.mocap.search.error_by_part import error_by_part
from services.mocap.search.found import Clock, FrameSolution
from services.mocap.search.jobs import LimbPool, limb_jobs
from services.mocap.search.model import Model
from services.mocap.search.settings import SearchSettings
from services.mocap.search.stages import descend_stage, whole_body_energy
from services.mocap.types import Floats


def solve_by_passes(
    model: Model, whole: Picture, starts: Floats, settings: SearchSettings, limbs: LimbPool
) -> FrameSolution:
    """Find the pose of one frame, beginning at the best of the start poses (N, D) within the limits.

    The paper, section 3: torso, then every limb with its hand or foot and the head, repeated until converged.
    The result is the best pose seen at the end of a pass, by the cost and the level of detail of the search;
    starts count as seen.
    """
    energy = whole_body_energy(model, whole, settings)
    energies = energy(starts)
    best = FrameSolution(
        starts[int(energies.argmin())].copy(), float(energies.min()), evaluations=len(starts)
    )
    # The paper, section 4.2: the torso is searched in whole pictures at half resolution.
    coarse, pose = whole.halved() if settings.windows else whole, best.pose
    for _ in range(settings.max_passes):
        before = best.energy_px
        pose = _one_pass(model, whole, coarse, pose, settings, limbs, best)
        energy_px = float(energy(pose[None])[0])
        best.passes, best.evaluations = best.passes + 1, best.evaluations + 1
        if energy_px < best.energy_px:
            best.pose, best.energy_px = pose, energy_px
        if before - energy_px <= settings.pass_tolerance * before:
            break
    best.note_shares(error_by_part(model, whole, best.pose))
    return best


def _one_pass(
    model: Model,
    whole: Picture,
    coarse: Picture,
    pose: Floats,
    settings: SearchSettings,
    limbs: LimbPool,
    account: FrameSolution,
) -> Floats:
    """Torso, then limbs and head at the same time; returns the new pose and notes times and evaluations."""
    clock = Clock(account.seconds)
    torso = descend_stage(model, TORSO.of(settings.body), coarse, pose, settings)
    pose = torso.applied_to(pose)
    clock.book("torso")
    limbs.start(limb_jobs(model, whole, pose, settings))
    head = descend_stage(model, HEAD.of(settings.body), whole, pose, settings)
    pose = head.applied_to(pose)
    clock.book("head")
    account.evaluations += torso.evaluations + head.evaluations
    for name, limb in limbs.finish():
        pose = limb.applied_to(pose)
        account.note_limb(name, limb)
    clock.book("limbs")
    return pose
