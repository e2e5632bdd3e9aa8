"""A bridge: it takes odometry and drives until the robot has come half a metre, and then tells so."""

from __future__ import annotations

from txt1.sidecar import Connection


def main(robot: Connection, distance: float = 0.5) -> None:
    robot.request("subscribe", topics=["/odom"], rate=20.0)
    told = False
    for telemetry in robot:
        x = telemetry["topics"].get("/odom", {}).get("x", 0.0)
        if x < distance:
            robot.request("drive", v=0.5, omega=0.0)
        elif not told:
            robot.request("drive", v=0.0, omega=0.0)
            robot.request("tell", text=f"came {distance} m")
            told = True
