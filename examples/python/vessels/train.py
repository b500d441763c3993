"""Trains a small U-Net on frames with masks (0 other, 1 nerve, 2 vessel) and prints its Dice on real test frames.

A set is a folder with `images` and `masks` of the same names, as that of the real frames and those of `render.py`.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import nn
from torch.nn import functional as F

CLASSES = ["nerve", "vessel"]
BLOCKS, BLOCK = 8, 5


def load(folder, names=None, side=80):
    """Frames in [0, 1] and masks, padded to a square and reduced to `side` pixels."""
    names = sorted(path.name for path in (folder / "images").glob("*.png")) if names is None else names
    if not names:
        raise SystemExit(f"{folder}/images has no PNG files")
    frames, masks = np.zeros((2, len(names), side, side), np.uint8)
    for i, name in enumerate(names):
        frame = Image.open(folder / "images" / name).convert("L")
        mask = Image.open(folder / "masks" / name)
        if mask.size != frame.size:
            raise SystemExit(f"{folder}: {name} has {frame.size} pixels, its mask {mask.size}")
        edge = max(frame.size)
        at = (edge - frame.width) // 2, (edge - frame.height) // 2
        for source, into, filter in (frame, frames, Image.BOX), (mask.convert("L"), masks, Image.NEAREST):
            square = Image.new("L", (edge, edge))
            square.paste(source, at)
            into[i] = np.asarray(square.resize((side, side), filter))
    if masks.max() > 2:
        raise SystemExit(f"{folder}: masks have values to {masks.max()}; expected 0 other, 1 nerve, 2 vessel")
    return torch.from_numpy(frames).float()[:, None] / 255, torch.from_numpy(masks).long()


def test_names(names):
    """Blocks of neighbours in number, spread evenly: neighbours are often of one volunteer."""
    step = len(names) / BLOCKS
    starts = [int(step * (k + 0.5)) - BLOCK // 2 for k in range(BLOCKS)]
    return [name for start in starts for name in names[start : start + BLOCK]]


class UNet(nn.Module):
    """Five levels of two convolutions each, 0.35 million parameters at the usual width."""

    def __init__(self, width=8):
        super().__init__()
        sizes = [width * factor for factor in (1, 2, 4, 8, 10)]

        def block(inputs, outputs):
            layers = []
            for size in (inputs, outputs):
                layers += [nn.Conv2d(size, outputs, 3, padding=1), nn.GroupNorm(4, outputs), nn.LeakyReLU(0.1, True)]
            return nn.Sequential(*layers)

        self.down = nn.ModuleList(block(a, b) for a, b in zip([1] + sizes, sizes))
        self.up = nn.ModuleList(block(a + b, a) for a, b in zip(sizes, sizes[1:]))
        self.last = nn.Conv2d(width, 3, 1)

    def forward(self, x):
        skips = []
        for level, block in enumerate(self.down):
            x = block(F.max_pool2d(x, 2) if level else x)
            skips.append(x)
        for block, skip in zip(reversed(self.up), reversed(skips[:-1])):
            x = block(torch.cat([skip, F.interpolate(x, scale_factor=2, mode="nearest")], 1))
        return self.last(x)


def standardised(x):
    """Mean 0 and standard deviation 1 over each frame, but for what is black around the sector."""
    seen = (x > 0.02).float()
    count = seen.sum((1, 2, 3), keepdim=True).clamp(min=1)
    mean = (x * seen).sum((1, 2, 3), keepdim=True) / count
    spread = (((x - mean) * seen).square().sum((1, 2, 3), keepdim=True) / count).sqrt()
    return (x - mean) / (spread + 1e-3)


def augmented(x, y, random):
    """Mirrored, turned, stretched, moved, with another grey map, noise and smoothing: the same for all sources."""
    n = len(x)

    def uniform(low, high, *shape):
        return torch.rand(n, *shape, generator=random) * (high - low) + low

    angle, zoom, stretch = uniform(-0.17, 0.17), uniform(-0.3, 0.3).exp(), uniform(-0.15, 0.15).exp()
    mirror = (uniform(0, 1) < 0.5).float() * 2 - 1
    cos, sin = angle.cos(), angle.sin()
    rows = [[cos * zoom * stretch * mirror, -sin * zoom, uniform(-0.2, 0.2)]]
    rows += [[sin * zoom * mirror, cos * zoom / stretch, uniform(-0.2, 0.2)]]
    matrix = torch.stack([torch.stack(row, 1) for row in rows], 1)
    grid = F.affine_grid(matrix, x.shape, align_corners=False)
    x = F.grid_sample(x, grid, align_corners=False)
    y = F.grid_sample(y[:, None].float(), grid, "nearest", align_corners=False)[:, 0].long()
    tall = (n, 1, 1, 1)
    x = x.clamp(min=0) ** uniform(-0.4, 0.4).exp().view(tall) * uniform(-0.3, 0.3).exp().view(tall)
    smooth = F.avg_pool2d(x, 3, 1, 1)
    x = x + uniform(-0.6, 1).view(tall) * (smooth - x)
    noise = torch.randn(x.shape, generator=random) * uniform(0, 0.04).view(tall) * (x > 0.02)
    return (x + noise).clamp(0, 1), y


def train(frames, masks, seed, steps, batch, width):
    torch.manual_seed(seed)
    random = torch.Generator().manual_seed(seed)
    net = UNet(width)
    optimiser = torch.optim.AdamW(net.parameters(), 3e-3, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 3e-3, steps)
    order = torch.cat([torch.randperm(len(frames), generator=random) for _ in range(steps * batch // len(frames) + 1)])
    for step in range(steps):
        chosen = order[step * batch : (step + 1) * batch]
        x, y = augmented(frames[chosen], masks[chosen], random)
        logits = net(standardised(x))
        shares = logits.softmax(1)
        truth = F.one_hot(y, 3).movedim(3, 1).float()
        overlap = 2 * (shares * truth).sum((0, 2, 3)) + 1
        dice = 1 - overlap / (shares.sum((0, 2, 3)) + truth.sum((0, 2, 3)) + 1)
        loss = F.cross_entropy(logits, y) + dice[1:].mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    return net.eval()


@torch.no_grad()
def predicted(net, frames):
    """Classes, by the mean over a frame and its mirror image."""
    x = standardised(frames)
    return torch.cat([(net(part) + net(part.flip(3)).flip(3)).argmax(1) for part in x.split(16)])


def dice(guess, truth):
    """By class: of all pixels of the set together, and the mean over the frames that have the class."""
    scores = {}
    for value, name in enumerate(CLASSES, 1):
        a, b = guess == value, truth == value
        both, sizes = (a & b).sum((1, 2)).double(), (a.sum((1, 2)) + b.sum((1, 2))).double()
        has = b.any(2).any(1)
        scores[name] = (2 * both.sum() / sizes.sum()).item()
        scores[name + "_by_frame"] = (2 * both / sizes)[has].mean().item()
    return scores


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--real", type=Path, required=True, help="folder of the real frames: 40 test, the others train")
    parser.add_argument("--test", type=Path, help="test on this folder; all of --real then train")
    parser.add_argument("--on", choices=["test", "train"], default="test", help="real frames that score")
    parser.add_argument("sets", nargs="*", help="NAME=FOLDER of synthetic frames, or `real` for the real ones")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--batch", type=int, default=12)
    parser.add_argument("--side", type=int, default=80, help="pixels of frames, a multiple of 16")
    parser.add_argument("--width", type=int, default=8, help="channels of the first level, a multiple of 4")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--least", type=float, default=0, help="Dice of vessels below which the command fails")
    parser.add_argument("-o", "--output", type=Path, help="JSON file of the scores; networks beside it")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)

    names = sorted(path.name for path in (options.real / "images").glob("*.png"))
    held = [] if options.test else test_names(names)
    kept = [name for name in names if name not in held]
    real = load(options.real, kept, options.side)
    test = load(options.test, None, options.side) if options.test else load(options.real, held, options.side)
    test = real if options.on == "train" else test
    results = {"test_frames": len(test[0]), "steps": options.steps, "batch": options.batch, "side": options.side}
    results["sets"] = {}
    heads = f"{'trained on':24} {'frames':>6} {'vessel':>13} {'nerve':>13} {'min':>5}"
    print(f"{heads}   Dice on {len(test[0])} real frames", flush=True)
    for item in options.sets:
        name, _, folder = item.partition("=")
        frames, masks = load(Path(folder), None, options.side) if folder else real
        began, scores = time.time(), []
        for seed in range(options.seeds):
            net = train(frames, masks, seed, options.steps, options.batch, options.width)
            scores.append(dice(predicted(net, test[0]), test[1]))
            table = {key: [score[key] for score in scores] for key in scores[0]}
            minutes = (time.time() - began) / 60
            results["sets"][name] = {"frames": len(frames), "minutes": minutes, **table}
            if options.output:
                torch.save(net.state_dict(), options.output.with_name(f"{name}-{seed}.pt"))
                options.output.write_text(json.dumps(results, indent=1))
        text = {key: f"{np.mean(all):.3f} +- {np.std(all, ddof=len(all) > 1):.3f}" for key, all in table.items()}
        print(f"{name:24} {len(frames):6} {text['vessel']:>13} {text['nerve']:>13} {minutes:5.1f}", flush=True)
        if np.mean(table["vessel"]) < options.least:
            raise SystemExit(f"{name}: the Dice of vessels is below {options.least}")


if __name__ == "__main__":
    main()
