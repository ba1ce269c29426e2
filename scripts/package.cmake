# `cpack` in the build folder makes toothprep_VERSION_ARCHITECTURE.deb of what `cmake --install` installs, with the
# packages it depends on found from the libraries it links; `cpack --config CPackSourceConfig.cmake` makes
# toothprep-VERSION.tar.gz of the sources. scripts/check-deb tries both. The page for users is data/install.md.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "toothprep's developers")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Haptic tooth preparation: forces, removal, calibration, scores")
set(CPACK_PACKAGE_DESCRIPTION
  "From a CT scan and the path of a handpiece: forces, torque and removal step by step at 1 kHz, the prepared
tooth, specific grinding energy fitted to measured forces, scores of preparations, and live sessions on a
haptic device. With the C++ library and the Python module.")
set(CPACK_SET_DESTDIR ON)  # so that install rules see the prefix that the files end up under
set(CPACK_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)

set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "python3, python3-numpy")
if(Python_VERSION_MINOR)  # the module is compiled for one version
  math(EXPR next "${Python_VERSION_MINOR} + 1")
  string(PREPEND CPACK_DEBIAN_PACKAGE_DEPENDS
    "python3 (>= ${Python_VERSION_MAJOR}.${Python_VERSION_MINOR}), python3 (<< ${Python_VERSION_MAJOR}.${next}), ")
endif()
# The scripts that plot; reading traces in Python.
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "python3-matplotlib, python3-h5py")
set(CPACK_DEBIAN_PACKAGE_SUGGESTS "python3-pandas, python3-openvdb")

set(CPACK_SOURCE_GENERATOR TGZ)
set(CPACK_SOURCE_PACKAGE_FILE_NAME ${PROJECT_NAME}-${PROJECT_VERSION})
set(CPACK_SOURCE_IGNORE_FILES "/[.]git$" "/[.]git/" "^${PROJECT_SOURCE_DIR}/build[^/]*/" "/quickstart-results/" "/__pycache__/" "[.]pyc$")
include(CPack)
