"""Trains the networks of the fruit detector: ``make train``.

``python -m robot.vision.training --rendered DIR --twin DIR --photos DIR --held-out DIR --out DIR --card FILE``:
labelled scenes as ``labelled.scenes`` reads them, photographs as ``labelled.photos`` (split ``train``; ``val`` for the
figures).
"""

from __future__ import annotations

import argparse
import io
import json
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch

from robot.vision.fruit.detector import FruitDetector
from robot.vision.fruit.judge import load_judge
from robot.vision.fruit.models import DIGESTS, load_models
from robot.vision.fruit.parameters import FruitParameters
from robot.vision.training.card import card
from robot.vision.training.export import export_outline, export_proposer, write_models
from robot.vision.training.figures import photo_figures, scene_figures
from robot.vision.training.labelled import photos, scenes
from robot.vision.training.recipe import Recipe
from robot.vision.training.schedule import Schedule
from robot.vision.training.traced import places_of
from robot.vision.training.train_judge import gather, train_judge
from robot.vision.training.train_outline import train_outline
from robot.vision.training.train_proposer import train_proposer
from robot.vision.training.views import views_of_photos, views_of_scenes


def main(arguments: list[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    recipe = Recipe()
    if options.steps is not None:
        recipe = replace(recipe, proposer_steps=options.steps, outline_steps=options.steps)
    cv2.setNumThreads(1)
    torch.set_num_threads(1)  # one thread and its helper process: more wait for each other than they help
    rendered, twin = list(scenes(options.rendered)), list(scenes(options.twin))
    pictures = list(views_of_photos(photos(options.photos, "train")))
    proposer = train_proposer(
        [
            (recipe.rendered_share, list(views_of_scenes(rendered))),
            (recipe.twin_share, list(views_of_scenes(twin))),
            (recipe.photo_share, pictures),
        ],
        Schedule(recipe.proposer_steps, recipe.seed),
    )
    traced = min(recipe.twin_traced, len(twin) // 2)
    outline = train_outline(places_of([*rendered, *twin[:traced]]), Schedule(recipe.outline_steps, recipe.seed))
    write_models(
        options.out,
        {"proposer.onnx": export_proposer(proposer), "outline.onnx": export_outline(outline)},
    )
    models = load_models(options.out)
    evidence = gather([*rendered, *twin[traced:]], models, FruitParameters())
    buffer = io.BytesIO()
    np.savez(buffer, **train_judge(evidence).arrays("judge"))  # type: ignore[arg-type]
    write_models(options.out, {"judge.npz": buffer.getvalue()})
    detector = FruitDetector(models=models, judge=load_judge(options.out))
    counts = {
        "rendered stereo scenes": len(rendered),
        "the twin's stereo scenes": len(twin),
        "photographs": len(pictures),
    }
    text = card(
        recipe, counts, scene_figures(detector, scenes(options.held_out)),
        photo_figures(detector, photos(options.photos, "val")), json.loads((options.out / DIGESTS).read_text()),
    )  # fmt: skip
    options.card.write_text(text, encoding="utf-8")
    sys.stderr.write(f"networks in {options.out}, their card in {options.card}\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m robot.vision.training", description=__doc__)
    for name, text in (
        ("--rendered", "folder of rendered stereo scenes to train on"),
        ("--twin", "folder of the twin's scenes (drivers.twin.labelled_scenes)"),
        ("--photos", "folder of photographs with boxes, train.txt and val.txt"),
        ("--held-out", "folder of stereo scenes for the figures"),
        ("--out", "folder for the networks"),
        ("--card", "the model card to write"),
    ):
        parser.add_argument(name, type=Path, required=True, help=text)
    parser.add_argument("--steps", type=int, help="steps of both networks, to try the way through")
    return parser


if __name__ == "__main__":
    sys.exit(main())
