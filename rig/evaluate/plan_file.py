"""The schema of evaluation plans: rows of conditions, each tried with some model bases and policies."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

MOST_TRIALS = 10_000_000

Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1, max_length=120)]


class Strict(BaseModel):
    """Frozen, and without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class NoiseEntry(Strict):
    """What a simulated detector does wrong, and how far the rig's poses are off (`CornerNoise`)."""

    missed: Share = 0.0
    false_parts: NotNegative = 0.0
    class_errors: Share = 0.0
    corner_sd_px: NotNegative = 0.0
    motion_theta_sd_deg: NotNegative = 0.0
    motion_sd_mm: NotNegative = 0.0


class InternalsEntry(Strict):
    """How the camera's inside changes from view to view; all 0: only the zoom changes it."""

    focal_sd: NotNegative = 0.05
    aspect_sd: NotNegative = 0.02
    centre_sd_px: NotNegative = 40.0


class ToldEntry(Strict):
    """What the recogniser is told of the bench, as a bench file would; left out, corner views follow the noise."""

    found: Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)] | None = None
    clutter: Positive | None = None
    corner_sd_px: Positive | None = None
    motion_theta_sd_deg: NotNegative | None = None
    motion_sd_mm: NotNegative | None = None


class RecogniserEntry(Strict):
    """How it recognises (`RecogniserSettings`)."""

    mode: Literal["graded", "paper"] = "graded"
    threshold: Annotated[float, Field(gt=0, le=1)] = 0.99
    max_views: Annotated[int, Field(ge=1, le=1000)] = 12
    pose_sd_mm: Positive | None = None
    pose_sd_deg: Positive | None = None


class FirstViewEntry(Strict):
    """What the first view of an experiment must show; parts count that show whole."""

    parts: Annotated[int | None, Field(ge=1, description="Exactly so many parts.")] = None
    classes: Annotated[str | None, Field(min_length=1, description="All of classes that begin so.")] = None
    two_faces: Annotated[bool, Field(description="Parts on two perpendicular faces.")] = False


class StartEntry(Strict):
    """A start found beforehand: object, seed of the scene, and which of the rig's poses."""

    object: Name
    seed: Annotated[int, Field(ge=0)]
    pose: Annotated[int, Field(ge=0)]


class ExperimentEntry(Strict):
    """One of the paper's experiments, staged (`rig.evaluate.experiments`).

    Attributes:
        number: as in the paper; title: what it is about.
        first_view: what it must show.
        hypotheses: that the first view must leave at least; paper_hypotheses: those that the paper tells, if it does.
        paper_views: that the paper took.
        trees_before: views, from 1, with a tree in front.
        half_blind: the detector misses a part from the second view on.
        third_zooms: zooms at which the third view is taken, a run for each.
        camera: the camera's inside, where it is not the usual one: aspect, u0_px, v0_px.
        starts: found beforehand; further ones are searched for, which takes long.
    """

    number: Annotated[int, Field(ge=1)]
    title: Name
    first_view: FirstViewEntry
    hypotheses: Annotated[int, Field(ge=1)]
    paper_hypotheses: int | None = None
    paper_views: Annotated[int, Field(ge=1)]
    trees_before: tuple[Annotated[int, Field(ge=1)], ...] = ()
    half_blind: bool = False
    third_zooms: tuple[Share, ...] = ()
    camera: dict[Literal["aspect", "u0_px", "v0_px"], Positive] = {}
    starts: tuple[StartEntry, ...] = ()


class RowEntry(Strict):
    """Conditions, tried with each of some model bases and policies."""

    name: Annotated[Name, Field(description="Names the conditions; the results call it `noise`.")]
    models: Annotated[tuple[Name, ...], Field(min_length=1)]
    policies: Annotated[tuple[Name, ...], Field(min_length=1)] | Literal["all"] = ("information",)
    without: Annotated[tuple[Name, ...], Field(description="Policies to leave out of all.")] = ()
    views: Annotated[Literal["corners", "rendered"], Field(description="Simulated corners, or pictures.")] = "corners"
    bench: Annotated[Literal["close_up", "one_axis"], Field(description="All axes, or a turntable.")] = "close_up"
    object: Annotated[Literal["in_base", "stranger"], Field(description="stranger: 20 % of its parts re-drawn.")] = (
        "in_base"
    )
    clutter: Annotated[bool, Field(description="Trees, pipes, jutting walls and reflections.")] = False
    noise: NoiseEntry | None = None
    internals: InternalsEntry = InternalsEntry()
    told: ToldEntry = ToldEntry()
    recogniser: RecogniserEntry = RecogniserEntry()
    experiment: ExperimentEntry | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.views == "rendered" and self.noise is not None:
            raise ValueError("rendered views have the noise of their pictures: give `noise` to corner views only")
        if self.views == "corners" and (self.clutter or self.experiment is not None):
            raise ValueError("clutter and experiments need pictures: add `views: rendered`")
        if self.experiment is not None and (self.bench, self.object) != ("close_up", "in_base"):
            raise ValueError("an experiment has a bench and an object of its own")
        if self.without and self.policies != "all":
            raise ValueError("`without` leaves policies out of `policies: all`; here they are named")
        return self


class PlanFile(Strict):
    """The schema of an evaluation plan."""

    # `schema` would hide a method of pydantic's models.
    version: Annotated[Literal[1], Field(alias="schema")]
    title: Name
    trials: Annotated[int, Field(ge=1, le=MOST_TRIALS, description="Over all rows, evenly.")]
    seed: Annotated[int, Field(ge=0, le=2**31)] = 0
    rows: Annotated[tuple[RowEntry, ...], Field(min_length=1)]
