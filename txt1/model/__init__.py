"""The vehicle on paper: its dimensions, kinematics and odometry equations, shared by simulation and control."""
