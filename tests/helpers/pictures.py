"""Pictures of boards, rendered by tracing the rays of every pixel to the board: no OpenCV, nothing from the package."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from tests.helpers.cameras import TrueCamera


def undistorted(camera: TrueCamera, pixels: np.ndarray) -> np.ndarray:
    """(N, 2) rays at a depth of one of pixels (N, 2), by iteration."""
    wanted = (pixels - np.array(camera.centre)) / np.array(camera.focal)
    k1, k2, p1, p2, k3 = camera.k
    found = wanted.copy()
    for _ in range(7):
        x, y = found.T
        r2 = x * x + y * y
        shift = np.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=1)
        found = (wanted - shift) / (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3)[:, None]
    return found


def rendered(camera: TrueCamera, board: np.ndarray, pattern: np.ndarray, cell: float, samples: int = 2) -> np.ndarray:
    """(h, w) grey values of a flat board, ``samples``² rays a pixel.

    Args:
        board: (4, 4) its pose in the frame of the camera; pattern: (rows, columns) grey values 0 to 255 of its cells.
        cell: side of a cell [m]; the origin of the board is the outer corner of the first one.
    """
    (w, h), R, t = camera.size, board[:3, :3], board[:3, 3]
    u, v = np.meshgrid(np.arange(w), np.arange(h))
    steps, total = (np.arange(samples) + 0.5) / samples - 0.5, np.zeros(h * w)
    for du in steps:
        for dv in steps:
            rays = undistorted(camera, np.stack([u.ravel() + du, v.ravel() + dv], axis=1))
            rays = np.column_stack([rays, np.ones(len(rays))])
            depth = (R[:, 2] @ t) / (rays @ R[:, 2])
            place = (rays * depth[:, None] - t) @ R[:, :2] / cell
            column, row = np.floor(place).astype(int).T
            inside = (column >= 0) & (row >= 0) & (column < pattern.shape[1]) & (row < pattern.shape[0])
            total += np.where(inside, pattern[row.clip(0, len(pattern) - 1), column.clip(0, pattern.shape[1] - 1)], 200)
    return (total / samples**2).reshape(h, w)


def chessboard(columns: int, rows: int) -> np.ndarray:
    """(rows + 3, columns + 3) squares around so many inner corners, with a white rim."""
    r, c = np.indices((rows + 1, columns + 1))
    return np.pad(np.where((r + c) % 2, 235, 25), 1, constant_values=235)


def write_png(path: Path, grey: np.ndarray) -> None:
    """An 8-bit grey PNG of values (h, w) from 0 to 255."""
    rows = np.round(grey).clip(0, 255).astype(np.uint8)

    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    head = struct.pack(">IIBBBBB", rows.shape[1], rows.shape[0], 8, 0, 0, 0, 0)
    raw = b"".join(b"\0" + row.tobytes() for row in rows)
    parts = (chunk(b"IHDR", head), chunk(b"IDAT", zlib.compress(raw, 1)), chunk(b"IEND", b""))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
