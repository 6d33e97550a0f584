"""The plan of a film for the page, which shows it while the takes play."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.film.actor import Actor
from engine_bridge.film.bubbles import bubbles_of
from engine_bridge.film.framing import View
from engine_bridge.film.plan import FilmPlan
from engine_bridge.film.production import Production, measure
from engine_bridge.film.scene import load
from engine_bridge.studio.long_work.worker import Progress
from engine_bridge.studio.messages import film_plan

MAX_MOMENTS = 2000
"""Maximum number of moments of a plan; of a longer film, every n-th frame is one."""

DIGITS = 4
"""Number of decimals of positions and shares."""


def plan_for_page(scene_file: Path, progress: Progress) -> film_plan.FilmPlan:
    """Return what a film shows at each of its frames.

    Raises
    ------
    PuppetlineError
    """
    scene = load(scene_file)
    size = scene.film.size
    bubbles = bubbles_of(scene, size, scene_file)
    production, extents = measure(scene_file, scene, progress)
    plan = FilmPlan(production, extents, bubbles, size)
    step = math.ceil(production.frames / MAX_MOMENTS)
    return film_plan.FilmPlan(
        size=size,
        step=step / production.fps,
        bubbles=[
            film_plan.BubbleShape(
                kind=each.table.kind,
                lines=[(line, round(width / size[0], DIGITS)) for line, width in each.lines],
                letter=each.letter / size[1],
                half=_shares(each.half, size),
            )
            for each in bubbles
        ],
        moments=[_moment(plan, production, size, frame) for frame in range(0, production.frames, step)],
    )


def _moment(plan: FilmPlan, production: Production, size: tuple[int, int], frame: int) -> film_plan.Moment:
    return film_plan.Moment(
        brightness=round(plan.brightness(frame), DIGITS),
        titles=[round(opacity, DIGITS) for opacity in plan.titles(frame)],
        views=[_view(plan, size, frame, view) for view in plan.views(frame)],
        places={actor.name: _place(actor, frame) for actor in production.actors},
    )


def _view(plan: FilmPlan, size: tuple[int, int], frame: int, view: View) -> film_plan.ShownView:
    return film_plan.ShownView(
        shot=view.shot,
        share=round(view.share, DIGITS),
        eye=_rounded(view.camera.eye),
        target=_rounded(view.camera.target),
        field_of_view=view.camera.field_of_view,
        bubbles=[
            film_plan.ShownBubble(
                number=number,
                opacity=round(opacity, DIGITS),
                middle=_shares(place.middle, size),
                tip=_shares(place.tip, size),
            )
            for number, opacity, place in plan.bubbles(frame, view)
        ],
    )


def _place(actor: Actor, frame: int) -> Any:
    """Return where a character stands: its position (3), which it walks from, and its turn."""
    place = actor.place(frame)
    return (*_rounded(place.position - actor.footing.lift), round(place.turn, DIGITS))


def _shares(pixels: NDArray[np.float64], size: tuple[int, int]) -> Any:
    return _rounded(pixels / size)


def _rounded(values: NDArray[np.float64]) -> Any:
    return tuple(np.round(values, DIGITS).tolist())
