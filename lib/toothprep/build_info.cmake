# toothprep::build_info: what this build was made of (build_info.h).
set(TOOTHPREP_COMMIT)
find_package(Git QUIET)
if(GIT_FOUND)
  execute_process(COMMAND ${GIT_EXECUTABLE} -C ${PROJECT_SOURCE_DIR} describe --always --dirty --abbrev=12 --exclude *
    OUTPUT_VARIABLE TOOTHPREP_COMMIT OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  # Another commit configures anew; what is changed between two commits shows only then.
  execute_process(COMMAND ${GIT_EXECUTABLE} -C ${PROJECT_SOURCE_DIR} rev-parse --git-path logs/HEAD
    OUTPUT_VARIABLE commits OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  get_filename_component(commits "${commits}" ABSOLUTE BASE_DIR ${PROJECT_SOURCE_DIR})
  if(EXISTS "${commits}" AND NOT IS_DIRECTORY "${commits}")
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${commits}")
  endif()
endif()

get_property(versions GLOBAL PROPERTY TOOTHPREP_VERSIONS)
list(REMOVE_DUPLICATES versions)
list(SORT versions CASE INSENSITIVE)
list(TRANSFORM versions REPLACE "^(.+)=(.+)$" "{\"\\1\", \"\\2\"}")
list(JOIN versions ",\n          " TOOTHPREP_LIBRARIES)
configure_file(${CMAKE_CURRENT_LIST_DIR}/build_info.cpp.in ${PROJECT_BINARY_DIR}/generated/build_info.cpp @ONLY)
add_library(toothprep_build_info STATIC ${PROJECT_BINARY_DIR}/generated/build_info.cpp)
add_library(toothprep::build_info ALIAS toothprep_build_info)
target_link_libraries(toothprep_build_info PRIVATE toothprep_options)
set_target_properties(toothprep_build_info PROPERTIES POSITION_INDEPENDENT_CODE ON)  # for the Python module
target_include_directories(toothprep_build_info PUBLIC ${PROJECT_SOURCE_DIR}/lib ${PROJECT_BINARY_DIR}/generated)
