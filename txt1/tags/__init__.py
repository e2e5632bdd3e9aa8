"""AprilTags as landmarks: tags at known places tell where the robot is."""
