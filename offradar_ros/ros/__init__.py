"""Messages, parameters and diagnostics: what stands between the core and rclpy."""
