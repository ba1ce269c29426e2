# What `cmake --install` gives to C++ projects: static libraries, public headers, and a package for find_package(). The
# page for users is data/library.md.
#
# A component is what a project links, toothprep::NAME: some modules, with all modules and packages that these need. Its
# public headers are the PUBLIC_HEADERS of those modules. Here, in the order of their edges:
set(TOOTHPREP_COMPONENTS step specimen io mesh scan calibrate score render live)
set(TOOTHPREP_OF_step session)
set(TOOTHPREP_OF_specimen specimen reference)
set(TOOTHPREP_OF_io session files)
set(TOOTHPREP_OF_mesh mesh mesh_files)
set(TOOTHPREP_OF_scan scan_files segmentation shells)
set(TOOTHPREP_OF_calibrate calibrate)
set(TOOTHPREP_OF_score score)
set(TOOTHPREP_OF_render render models)
set(TOOTHPREP_OF_live live_session)

include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
set(TOOTHPREP_PACKAGE_FOLDER ${CMAKE_INSTALL_LIBDIR}/cmake/toothprep)
get_property(built GLOBAL PROPERTY TOOTHPREP_MODULES)  # each after those that it needs

# Sets `result` to the modules and all that they need, each after those that it needs.
function(toothprep_with_needed_modules result)
  set(found ${ARGN})
  set(left ${ARGN})
  while(left)
    list(POP_FRONT left module)
    get_target_property(needed toothprep_${module} TOOTHPREP_NEEDS)
    foreach(one IN LISTS needed)
      if(NOT one IN_LIST found)
        list(APPEND found ${one})
        list(APPEND left ${one})
      endif()
    endforeach()
  endwhile()
  set(ordered ${built})
  foreach(module IN LISTS built)
    if(NOT module IN_LIST found)
      list(REMOVE_ITEM ordered ${module})
    endif()
  endforeach()
  set(${result} ${ordered} PARENT_SCOPE)
endfunction()

set(installed_modules)
set(installed_components)
set(TOOTHPREP_TABLE)  # for the package's configuration
foreach(component IN LISTS TOOTHPREP_COMPONENTS)
  set(own ${TOOTHPREP_OF_${component}})
  list(REMOVE_ITEM own ${built})
  if(own)
    continue()  # TOOTHPREP_STEP_ONLY
  endif()
  list(APPEND installed_components ${component})
  add_library(toothprep_component_${component} INTERFACE)
  add_library(toothprep::${component} ALIAS toothprep_component_${component})
  list(TRANSFORM TOOTHPREP_OF_${component} PREPEND toothprep::module_ OUTPUT_VARIABLE libraries)
  target_link_libraries(toothprep_component_${component} INTERFACE ${libraries})
  target_compile_features(toothprep_component_${component} INTERFACE cxx_std_20)
  set_target_properties(toothprep_component_${component} PROPERTIES EXPORT_NAME ${component})
  install(TARGETS toothprep_component_${component} EXPORT toothprep-${component})
  install(EXPORT toothprep-${component} NAMESPACE toothprep:: FILE ${component}.cmake
    DESTINATION ${TOOTHPREP_PACKAGE_FOLDER} COMPONENT development)

  toothprep_with_needed_modules(modules ${TOOTHPREP_OF_${component}})
  set(packages)
  foreach(module IN LISTS modules)
    get_target_property(its toothprep_${module} TOOTHPREP_PACKAGES)
    list(APPEND packages ${its})
  endforeach()
  list(REMOVE_DUPLICATES packages)
  string(APPEND TOOTHPREP_TABLE "set(toothprep_modules_of_${component} ${modules})\n"
    "set(toothprep_packages_of_${component} ${packages})\n")
  list(APPEND installed_modules ${modules})
endforeach()
list(REMOVE_DUPLICATES installed_modules)
string(REPLACE ";" " " TOOTHPREP_TABLE "${TOOTHPREP_TABLE}")

foreach(module IN LISTS installed_modules)
  install(TARGETS toothprep_${module} EXPORT toothprep-module-${module}
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development
    INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
  install(EXPORT toothprep-module-${module} NAMESPACE toothprep:: FILE module_${module}.cmake
    DESTINATION ${TOOTHPREP_PACKAGE_FOLDER} COMPONENT development)
  get_target_property(headers toothprep_${module} TOOTHPREP_PUBLIC_HEADERS)
  get_target_property(folder toothprep_${module} SOURCE_DIR)
  if(headers)
    list(TRANSFORM headers PREPEND ${folder}/)
    file(RELATIVE_PATH place ${PROJECT_SOURCE_DIR}/lib ${folder})
    install(FILES ${headers} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/${place} COMPONENT development)
  endif()
endforeach()

configure_file(${CMAKE_CURRENT_LIST_DIR}/version.h.in ${PROJECT_BINARY_DIR}/generated/toothprep/version.h @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/generated/toothprep/version.h
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/toothprep COMPONENT development)
set(data_folder share/toothprep)  # where the program looks for it
configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/toothprep-config.cmake.in
  ${PROJECT_BINARY_DIR}/generated/toothprep-config.cmake INSTALL_DESTINATION ${TOOTHPREP_PACKAGE_FOLDER}
  PATH_VARS data_folder)
# 0.x: what a minor version changes may break what was written for another.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/generated/toothprep-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/generated/toothprep-config.cmake
  ${PROJECT_BINARY_DIR}/generated/toothprep-config-version.cmake ${CMAKE_CURRENT_LIST_DIR}/Findlibdeflate.cmake
  DESTINATION ${TOOTHPREP_PACKAGE_FOLDER} COMPONENT development)
