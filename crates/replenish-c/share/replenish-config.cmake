# find_package(replenish) gives replenish::replenish and replenish::static.
get_filename_component(_replenish "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
find_package(Threads REQUIRED)
if(NOT TARGET replenish::replenish)
  add_library(replenish::replenish SHARED IMPORTED)
  set_target_properties(replenish::replenish PROPERTIES
    IMPORTED_LOCATION "${_replenish}/lib/libreplenish.so"
    INTERFACE_INCLUDE_DIRECTORIES "${_replenish}/include"
    INTERFACE_LINK_LIBRARIES Threads::Threads)
  add_library(replenish::static STATIC IMPORTED)
  set_target_properties(replenish::static PROPERTIES
    IMPORTED_LOCATION "${_replenish}/lib/libreplenish.a"
    INTERFACE_INCLUDE_DIRECTORIES "${_replenish}/include"
    INTERFACE_LINK_LIBRARIES "Threads::Threads;gcc_s;util;rt;m;${CMAKE_DL_LIBS}")
endif()
unset(_replenish)
