"""Everything the robot did, on disk as MCAP with ROS 2 messages: written, recovered, listed, replayed, drawn."""
