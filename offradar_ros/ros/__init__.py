"""Messages, parameters and diagnostics: the layer between the core and rclpy."""
