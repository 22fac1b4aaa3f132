"""Recordings as rosbag2 bags in MCAP, with standard ROS 2 messages. Needs the extra `bags`; imported on use alone."""
