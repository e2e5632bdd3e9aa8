"""Shows FILE in Rerun with a layout, or saves the layout with it to another file. Runs under the Python with Rerun."""

import sys

import rerun as rr
import rerun.blueprint as rrb


def layout() -> rrb.Blueprint:
    """The world on the left; the camera, speeds, outputs and events on the right."""
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                name="World",
                contents=["+ /**", "- /sensors/camera/**"],
                spatial_information=rrb.SpatialInformation(target_frame="odom"),
            ),
            rrb.Vertical(
                rrb.Spatial2DView(
                    name="Camera",
                    origin="/sensors/camera",
                    spatial_information=rrb.SpatialInformation(target_frame="base_camera_optical_link_image_plane"),
                ),
                rrb.TimeSeriesView(name="Odometry", origin="/odom/speeds"),
                rrb.TimeSeriesView(name="Set-point", origin="/setpoint/speeds"),
                rrb.TimeSeriesView(name="Outputs", origin="/pwm/outputs"),
                rrb.TextLogView(name="Events", origin="/rosout"),
            ),
        ),
        collapse_panels=True,
    )


def main(file: str, save: str = "") -> None:
    """Show the file, or save it with the layout."""
    rr.init("txt1", spawn=not save)
    if save:
        rr.save(save)
    rr.send_blueprint(layout())
    rr.log_file_from_path(file)
    rr.disconnect()


if __name__ == "__main__":
    main(*sys.argv[1:])
