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

SCANNERS = ["raw", "clinical"]
MASKS = {"epineurium": 1, "fascicle": 1, "artery": 2, "vein": 2}

# What differs from frame to frame, by key: scanner, probe, and the look of tissues in another body.
VARIED = {
    "probe.depth_mm": "integer = [25, 52]",
    "probe.frequency_mhz": "uniform = [7.0, 12.0]",
    "probe.bandwidth": "uniform = [0.2, 0.7]",
    "probe.transmit_f_number": "uniform = [2.0, 6.0]",
    "probe.receive_f_number": "uniform = [1.5, 5.0]",
    "tone.gain_db": "uniform = [-7, 7]",
    "tone.dynamic_range_db": "uniform = [45, 75]",
    "tone.gamma": "uniform = [0.7, 1.3]",
    "tone.auto_gain": "uniform = [0.1, 1.0]",
    "texture.strength": "uniform = [0.3, 1.0]",
    "haze.level_db": "uniform = [-26, -8]",
    "receiver.noise_db": "uniform = [-100, -75]",
    "receiver.clutter_db": "uniform = [-40, -14]",
    "pose.tilt_deg": "uniform = [-10, 10]",
    "pose.rock_deg": "uniform = [-5, 5]",
    "pose.rotate_deg": "uniform = [-25, 25]",
    "fat.echogenicity_db": "uniform = [-8, 4]",
    "muscle_limb.echogenicity_db": "uniform = [-20, 0]",
    "muscle_limb.attenuation_db_cm_mhz": "uniform = [0.6, 2.0]",
    "muscle.echogenicity_db": "uniform = [-20, 0]",
    "muscle.attenuation_db_cm_mhz": "uniform = [0.6, 2.0]",
    "intermuscular_fat.echogenicity_db": "uniform = [-6, 6]",
    "intermuscular_fat.impedance_mrayl": "uniform = [1.5, 1.7]",
    "fascia.echogenicity_db": "uniform = [4, 14]",
    "artery.echogenicity_db": "uniform = [-50, -18]",
    "artery.capsule": "uniform = [0.0, 0.2]",
    "vein.echogenicity_db": "uniform = [-50, -18]",
    "vein.capsule": "uniform = [0.0, 0.12]",
    "vessel_wall.echogenicity_db": "uniform = [-10, 10]",
    "vessel_wall.impedance_mrayl": "uniform = [1.64, 1.72]",
    "epineurium.echogenicity_db": "uniform = [2, 13]",
    "fascicle.echogenicity_db": "uniform = [-22, 0]",
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
    scanner = SCANNERS[phantom % len(SCANNERS)] if options.scanner == "all" else options.scanner
    path = options.output / "scenes" / f"{phantom:05}.toml"
    path.write_text(scene(phantom, scanner, not options.fixed, options.pixels))
    array = path.with_suffix(".npy")
    command = [options.insonify, "render", path, "--frames", str(options.frames), "--backend", "cpu"]
    command += ["--layers", "label-value", "--sidecar", "--force", "-o", array]
    done = subprocess.run(command, capture_output=True, text=True)
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
    parser.add_argument("--scanner", choices=["all", *SCANNERS], default="all")
    parser.add_argument("--fixed", action="store_true", help="vary nothing but the anatomy and the tilt")
    parser.add_argument("--pixels", type=int, default=256)
    options = parser.parse_args()
    for folder in "images", "masks", "scenes":
        (options.output / folder).mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(lambda phantom: render(options, phantom), range(options.first, options.first + options.phantoms)))


if __name__ == "__main__":
    main()
