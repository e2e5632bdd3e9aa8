"""The graph of a map as a file, NAME.graph: poses, edges and clouds, so that a later drive can extend the map.

It is a NumPy archive without pickled objects; equal graphs give equal bytes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, Final
from zipfile import ZipFile

import numpy as np

from txt1.errors import ConfigError
from txt1.file_limits import GRAPH_MAX, read_bytes
from txt1.mapping import grid_files
from txt1.mapping.graph import EDGE
from txt1.mapping.mapper import KeyScan, Mapper
from txt1.mapping.matcher import Cloud
from txt1.maps.files import keep_out_of

VERSION: Final = 1
SUFFIXES: Final = (".graph", ".pgm", ".svg", ".yaml")
"""Suffixes of a map's files; the .yaml is written last: when it is there, all files are there."""


PARTS: Final[dict[str, tuple[type, tuple[int, ...]]]] = {
    "poses": (np.float64, (3,)),
    "counts": (np.int64, ()),
    "times": (np.float64, ()),
    "points": (np.float64, (2,)),
    "normals": (np.float64, (2,)),
    **{name: (EDGE[name].base.type, EDGE[name].shape) for name in EDGE.names or ()},
}
"""Each part of a graph: the type of its values, and the shape of each entry."""


def _part(file: Mapping[str, Any], name: str, kind: type, shape: tuple[int, ...]) -> Any:
    """Return a part of a graph; raises ValueError: it is of another type or shape."""
    part = file[name]
    if part.dtype != kind or part.shape[1:] != shape or part.ndim != 1 + len(shape):
        raise ValueError(f"{name}: {part.dtype} of shape {part.shape}")
    return part


def content(mapper: Mapper, about: dict[str, Any]) -> bytes:
    """Return the bytes of a mapper's graph; `about` is stored with it as JSON."""
    keys = mapper.keys
    told = {"version": VERSION, **about}
    parts: dict[str, Any] = dict(
        about=np.frombuffer(json.dumps(told, sort_keys=True).encode(), np.uint8),
        poses=mapper.graph.poses,
        # field by field: rows of a structured array have gaps with arbitrary bytes
        **{name: np.ascontiguousarray(mapper.graph.edges[name]) for name in EDGE.names or ()},
        counts=np.array([len(key.cloud.points) for key in keys], np.int64),
        times=np.array([key.time for key in keys]),
        points=np.concatenate([key.cloud.points for key in keys]),
        normals=np.concatenate([key.cloud.normals for key in keys]),
    )
    file = BytesIO()
    np.savez(file, **parts)
    return file.getvalue()


def load(path: Path) -> tuple[Mapper, dict[str, Any]]:
    """Return the mapper of a graph's file, ready for another drive, and the `about` stored with it.

    Raises ConfigError: the file is no graph, or is damaged.
    """
    try:
        data = BytesIO(read_bytes(path, GRAPH_MAX))
        with ZipFile(data) as archive:
            if sum(each.file_size for each in archive.infolist()) > GRAPH_MAX:
                raise ValueError(f"it unpacks to more than {GRAPH_MAX} bytes")
        with np.load(data, allow_pickle=False) as file:
            told = json.loads(file["about"].tobytes())
            if told.get("version") != VERSION:
                raise ConfigError(f"{path}: of version {told.get('version')}, and this txt1 reads {VERSION}; map anew")
            parts = {name: _part(file, name, *kind) for name, kind in PARTS.items()}
        mapper = Mapper()
        if parts["counts"].min(initial=0) < 0:
            raise ValueError("a scan has fewer points than none")
        ends = np.cumsum(parts["counts"])
        if len(parts["poses"]) != len(ends) or ends[-1] != len(parts["points"]) or len(parts["times"]) != len(ends):
            raise ValueError("its parts have different lengths")
        if not all(np.isfinite(parts[name]).all() for name in ("poses", "points", "normals", "step", "information")):
            raise ValueError("a value is no number")
        nodes = np.concatenate((parts["first"], parts["second"]))
        if nodes.max(initial=0) >= len(ends) or nodes.min(initial=0) < 0:
            raise ValueError("an edge leads to no node")
        points, normals = np.split(parts["points"], ends[:-1]), np.split(parts["normals"], ends[:-1])
        keys = [
            KeyScan(-1, float(time), Cloud(np.ascontiguousarray(p), np.ascontiguousarray(n)))
            for time, p, n in zip(parts["times"], points, normals, strict=True)
        ]
        edges = zip(*(parts[name] for name in EDGE.names or ()), strict=True)
        mapper.resume(keys, parts["poses"], edges)
    except ConfigError:
        raise
    except Exception as error:
        # each layer of an archive has errors of its own for what is damaged
        raise ConfigError(
            f"{path}: no graph of a map, or a damaged one ({error}); make the map again with --new"
        ) from None
    return mapper, told


def files_of(mapper: Mapper, output: Path, resolution: float, drives: list[str]) -> tuple[dict[Path, bytes], str]:
    """Return the contents of a map's files, whose names begin with `output`, and a remark if its cells are larger than
    `resolution` m.
    """
    grid = grid_files.grid_of([key.cloud for key in mapper.keys], mapper.graph.poses, mapper.loops, resolution)
    # a person wrote these into the .yaml
    areas = keep_out_of(output.with_name(f"{output.name}.yaml"))
    contents = grid_files.contents(grid, output.name, [("#d04010", mapper.poses)], areas)
    contents[".graph"] = content(mapper, {"drives": drives})
    files = {output.with_name(output.name + suffix): contents[suffix] for suffix in SUFFIXES}
    return files, grid_files.coarser(grid.resolution, resolution)
