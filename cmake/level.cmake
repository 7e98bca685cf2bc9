# SPDX-License-Identifier: BSD-3-Clause
# SYMSDE_LEVEL, the level that `pip install` compiles for: the highest level of x86-64 that this processor has; empty if
# this is the first level. The library is put into a folder of this name, so that no lower processor loads it.
if(DEFINED SYMSDE_LEVEL OR NOT CMAKE_SYSTEM_NAME STREQUAL "Linux" OR CMAKE_CROSSCOMPILING
   OR NOT CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|amd64|AMD64)$")
   return()
endif()
set(_level "")
foreach(_candidate x86-64-v4 x86-64-v3)
   set(_source ${PROJECT_BINARY_DIR}/${_candidate}.c)
   file(WRITE ${_source} "int main(void) { return !__builtin_cpu_supports(\"${_candidate}\"); }\n")
   try_run(_ended _compiled ${PROJECT_BINARY_DIR} ${_source})
   if(_compiled AND _ended EQUAL 0)
      set(_level ${_candidate})
      break()
   endif()
endforeach()
set(SYMSDE_LEVEL "${_level}" CACHE STRING "Level of x86-64 that a Python package is compiled for")
message(STATUS "Compiling for one level of processors: ${SYMSDE_LEVEL}")
