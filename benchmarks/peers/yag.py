"""yag-slam on one log, in an environment of its own: ``python yag.py IN.npz OUT.npz``; see benchmarks.mapping."""

import sys
from importlib.metadata import version
from time import process_time

import numpy as np
from yag_slam.graph_slam import GraphSlam
from yag_slam.models import LocalizedRangeScan
from yag_slam.scan_matching import Scan2DMatcherCpp


def main() -> None:
    """Give it scan after scan with its own settings, and keep the poses of its graph."""
    log = np.load(sys.argv[1])
    start, step, longest = float(log["start"]), float(log["step"]), float(log["longest"])
    threshold = min(longest, 20.0)
    ranges, odometry = log["ranges"], log["odometry"]
    slam = GraphSlam(Scan2DMatcherCpp({}), Scan2DMatcherCpp({}, loop=True))
    begin = process_time()
    end = start + step * (ranges.shape[1] - 1)
    for row, pose in zip(ranges, odometry, strict=True):
        slam.process_scan(LocalizedRangeScan(row, start, end, step, 0.05, longest, threshold, *pose))
    slam.run_opt()
    spent = process_time() - begin
    poses = [vertex.obj.corrected_pose for vertex in slam.graph.vertices]
    np.savez(
        sys.argv[2],
        poses=np.array([(pose.x, pose.y, pose.euler[-1]) for pose in poses]),
        spent=spent,
        version=version("yag-slam"),
    )


main()
