# SPDX-License-Identifier: BSD-3-Clause
# Where `cmake --install` puts library, header, module files, CMake package, and pkg-config file.
include(CMakePackageConfigHelpers)

if(SKBUILD)
   # A Python package holds the library only, beside or below the files that load it.
   set(_folder symsde)
   if(SYMSDE_LEVEL)
      set(_folder symsde/glibc-hwcaps/${SYMSDE_LEVEL})
   endif()
   install(TARGETS symsde LIBRARY DESTINATION ${_folder})
   return()
endif()

set(_package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/symsde)
install(TARGETS symsde EXPORT symsde-targets)
install(EXPORT symsde-targets NAMESPACE symsde:: DESTINATION ${_package_dir})
install(FILES include/symsde.h include/symsde.hpp DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(FILES include/symsde/models.hpp DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/symsde)
install(DIRECTORY ${SYMSDE_MODULE_DIR}/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/${SYMSDE_MODULE_SUBDIR})

configure_package_config_file(cmake/symsde-config.cmake.in symsde-config.cmake
   INSTALL_DESTINATION ${_package_dir})
write_basic_package_version_file(symsde-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES
   ${CMAKE_CURRENT_BINARY_DIR}/symsde-config.cmake
   ${CMAKE_CURRENT_BINARY_DIR}/symsde-config-version.cmake
   DESTINATION ${_package_dir})

# Relative, so that an installed tree can be moved.
file(RELATIVE_PATH SYMSDE_PC_TO_PREFIX /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
string(REGEX REPLACE "/$" "" SYMSDE_PC_TO_PREFIX "${SYMSDE_PC_TO_PREFIX}")
set(_private "-llapack -lblas -lgfortran -lgomp -lm")
set(SYMSDE_PC_LIBS "")
set(SYMSDE_PC_PRIVATE "\nLibs.private: ${_private}")
if(SYMSDE_KIND STREQUAL "STATIC")
   set(SYMSDE_PC_LIBS " ${_private}")  # programs linked to an archive need these, with or without pkg-config --static
   set(SYMSDE_PC_PRIVATE "")
endif()
configure_file(cmake/symsde.pc.in symsde.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/symsde.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
