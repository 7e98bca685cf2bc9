# SPDX-License-Identifier: BSD-3-Clause
# The library again for newer x86-64 processors, in folders with the names that glibc searches beside a library that a
# program is linked with (glibc-hwcaps); Python chooses among the same folders. All variants compute the same bits. The
# library beside the folders is for processors without fused multiply-add, and rounds products.
if(NOT SYMSDE_FLAGS STREQUAL "release" OR NOT CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|amd64|AMD64)$")
   message(FATAL_ERROR "SYMSDE_VARIANTS is ON, for SYMSDE_FLAGS '${SYMSDE_FLAGS}' on ${CMAKE_SYSTEM_PROCESSOR}: "
      "variants are those of the flags release on x86-64.")
endif()
if(SYMSDE_KIND STREQUAL "STATIC")
   message(FATAL_ERROR "SYMSDE_VARIANTS is ON, and BUILD_SHARED_LIBS is OFF: a program that holds the library has one "
      "variant of it. Leave one of the two out.")
endif()
set(_beside ${CMAKE_INSTALL_LIBDIR})
if(SKBUILD)
   set(_beside symsde)
   target_compile_options(symsde PRIVATE -march=x86-64-v2)  # what NumPy's wheels need, too
   # Processors without AVX2 are from before 2013, or small. Their variant is a fifth smaller in a wheel with -O2, which
   # comes behind the other flags, and takes 1.2 to 2.1 of the time; pip compiles a fast one. It rounds products, so
   # its bits are the same.
   add_library(symsde_compact INTERFACE)
   target_compile_options(symsde_compact INTERFACE -O2)
   target_link_libraries(symsde PRIVATE $<BUILD_INTERFACE:symsde_compact>)
endif()
get_target_property(_sources symsde SOURCES)
foreach(_level x86-64-v3 x86-64-v4)
   set(_target symsde-${_level})
   add_library(${_target} SHARED ${_sources})
   symsde_set_up(${_target} ${PROJECT_BINARY_DIR}/variants/${_level} ${PROJECT_BINARY_DIR}/glibc-hwcaps/${_level})
   target_compile_options(${_target} PRIVATE -march=${_level})
   set_target_properties(${_target} PROPERTIES OUTPUT_NAME symsde)
   install(TARGETS ${_target} LIBRARY DESTINATION ${_beside}/glibc-hwcaps/${_level} NAMELINK_SKIP)
endforeach()
