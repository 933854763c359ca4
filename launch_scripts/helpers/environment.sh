# Sourced by the launch scripts: keep a sourced ROS, or another Python environment, out of ours.

unset PYTHONPATH PYTHONHOME VIRTUAL_ENV AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
unset LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
# Compiled copies are what makes the second start quick.
unset PYTHONDONTWRITEBYTECODE
unset ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION RMW_IMPLEMENTATION
