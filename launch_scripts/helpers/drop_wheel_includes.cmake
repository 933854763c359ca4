# Passed by build_messages.sh as CMAKE_PROJECT_TOP_LEVEL_INCLUDES; not used with ROS from apt.
#
# The ROS wheels' CMake targets name the include folders of the Python they were built with,
# /opt/python/..., which exist nowhere else, and CMake refuses targets that do. Once the whole
# CMakeLists.txt has been read, drop those folders from every imported target.

function(depth_pose_drop_wheel_includes)
  get_property(targets DIRECTORY "${CMAKE_SOURCE_DIR}" PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    foreach(property INTERFACE_INCLUDE_DIRECTORIES INTERFACE_SYSTEM_INCLUDE_DIRECTORIES)
      get_target_property(folders ${target} ${property})
      if(folders)
        list(FILTER folders EXCLUDE REGEX "^/opt/python/")
        set_target_properties(${target} PROPERTIES ${property} "${folders}")
      endif()
    endforeach()
  endforeach()
endfunction()

cmake_language(DEFER DIRECTORY "${CMAKE_SOURCE_DIR}" CALL depth_pose_drop_wheel_includes)
