"""Renders frames of vessels and nerves with masks by the command `insonify`, from the phantom `limb` by seed.

Each phantom is one scene with a few frames, whose parameters `[randomise]` draws. OUTPUT gets `images` and `masks`
(0 other, 1 nerve, 2 vessel) of the same names, and `scenes`.
"""

import argparse
import json
import os
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image

MASKS = {"epineurium": 1, "fascicle": 1, "artery": 2, "vein": 2}

# What differs from frame to frame, by key: scanner, probe, and the look of tissues in another body.
VARIED = {
    "probe.depth_mm": "integer = [22, 56]",
    "probe.frequency_mhz": "uniform = [7.0, 12.0]",
    "probe.bandwidth": "uniform = [0.25, 0.7]",
    "tone.gain_db": "uniform = [-10, 8]",
    "tone.dynamic_range_db": "uniform = [45, 80]",
    "tone.gamma": "uniform = [0.7, 1.3]",
    "tone.auto_gain": "uniform = [0.3, 1.0]",
    "haze.level_db": "uniform = [-28, -10]",
    "receiver.noise_db": "uniform = [-100, -60]",
    "receiver.clutter_db": "uniform = [-40, -14]",
    "pose.tilt_deg": "uniform = [-10, 10]",
    "pose.rock_deg": "uniform = [-5, 5]",
    "pose.rotate_deg": "uniform = [-25, 25]",
    "fat.echogenicity_db": "uniform = [-8, 4]",
    "muscle_limb.echogenicity_db": "uniform = [-12, 1]",
    "muscle.echogenicity_db": "uniform = [-12, 1]",
    "intermuscular_fat.echogenicity_db": "uniform = [-3, 7]",
    "fascia.echogenicity_db": "uniform = [5, 14]",
    "artery.echogenicity_db": "uniform = [-56, -22]",
    "vein.echogenicity_db": "uniform = [-56, -22]",
    "vessel_wall.echogenicity_db": "uniform = [0, 12]",
    "epineurium.echogenicity_db": "uniform = [0, 9]",
    "fascicle.echogenicity_db": "uniform = [-18, -3]",
    "lymph_node.echogenicity_db": "uniform = [-16, -5]",
}


def scene(phantom, scanner, varied, pixels):
    """The scene of a phantom, as text. Slide, press and the side of the body are of the whole scene."""
    draw = np.random.default_rng(phantom)
    slide, press = (draw.uniform(-9, 9), draw.uniform(-0.5, 3)) if varied else (0.0, 0.0)
    lines = [
        f"seed = {phantom % 4}",  # textures follow from it: few, which the command keeps
        f'scanner = "{scanner}"',
        f'volume = {{ phantom = "limb", seed = {phantom}, resolution_mm = 0.4 }}',
        "pose = { position_mm = [%.2f, %.2f, 0], direction = [0, 1, 0] }" % (slide, press),
        f"image = {{ width = {pixels}, height = {pixels}, margin = 0.0 }}",
        "[randomise]",
        f"seed = {phantom}",
    ]
    # Without ranges frames of a scene would be the same: the pose differs a little.
    chosen = VARIED if varied else {"pose.tilt_deg": "uniform = [-10, 10]"}
    return "\n".join(lines + [f"{key} = {{ {how} }}" for key, how in chosen.items()]) + "\n"


def render(options, phantom):
    scanner = options.scanner if options.scanner != "both" else ("raw", "clinical")[phantom % 2]
    path = options.output / "scenes" / f"{phantom:05}.toml"
    path.write_text(scene(phantom, scanner, not options.fixed, options.pixels))
    array = path.with_suffix(".npy")
    command = [options.insonify, "render", path, "--frames", str(options.frames), "--layers", "label-value"]
    done = subprocess.run([*command, "--sidecar", "--backend", "cpu", "--force", "-o", array], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{path}:\n{done.stderr}")
    labels = json.loads((path.with_suffix("") / "parameters.json").read_text())["labels"]
    values = array.with_name(f"{path.stem}_label-value.npy")
    table = np.zeros(256, np.uint8)
    for label in labels:
        table[label["value"]] = MASKS.get(label["name"], 0)
    for i, (frame, label) in enumerate(zip(np.load(array), np.load(values))):
        for folder, pixels in ("images", frame), ("masks", table[label]):
            Image.fromarray(pixels).save(options.output / folder / f"limb_{phantom:05}_{i}.png")
    array.unlink()
    values.unlink()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path)
    parser.add_argument("--insonify", default="insonify", help="the command")
    parser.add_argument("--phantoms", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first phantom")
    parser.add_argument("--frames", type=int, default=3, help="of each phantom")
    parser.add_argument("--scanner", choices=["both", "raw", "clinical"], default="both")
    parser.add_argument("--fixed", action="store_true", help="vary nothing but the anatomy and the tilt")
    parser.add_argument("--pixels", type=int, default=256)
    options = parser.parse_args()
    for folder in "images", "masks", "scenes":
        (options.output / folder).mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(lambda phantom: render(options, phantom), range(options.first, options.first + options.phantoms)))


if __name__ == "__main__":
    main()
