"""A bridge: it drives as fast as the speed limit allows, and tells how fast that is."""

from txt1.sidecar import Connection


def main(robot: Connection, share: float = 1.0) -> None:
    """Drive at this share of the limit."""
    robot.request("subscribe", topics=["/speed_limit"], rate=20.0)
    told = False
    for telemetry in robot:
        limit = telemetry["topics"].get("/speed_limit")
        if limit is not None:
            robot.request("drive", v=share * limit, omega=0.0)
            if not told:
                robot.request("tell", text=f"the limit is {limit} m/s")
                told = True
