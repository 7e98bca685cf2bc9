# SPDX-License-Identifier: BSD-3-Clause
# Compile SOURCE, a C++17 program, by each of CXX (separated by commas) with strict warnings as errors, against the
# headers and the library of a build, and run it. FLAGS: sanitizers, which program and library share. SYMSDE_INCLUDE in
# the environment stands for INCLUDE.
string(REPLACE "," ";" CXX "${CXX}")
if(NOT CXX)
   message("skipped: there is no C++ compiler")
   return()
endif()
if(DEFINED ENV{SYMSDE_INCLUDE})
   set(INCLUDE $ENV{SYMSDE_INCLUDE})
endif()
file(MAKE_DIRECTORY ${WORK})
get_filename_component(folder ${LIBRARY} DIRECTORY)
string(RANDOM name)  # the suites that judge planted faults run it several times at once
foreach(compiler IN LISTS CXX)
   execute_process(
      COMMAND ${compiler} -std=c++17 -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wold-style-cast
         -Wmissing-declarations -Wnon-virtual-dtor -Werror ${FLAGS} -DTEST_VERSION="${VERSION}" -I${INCLUDE}
         ${SOURCE} ${LIBRARY} -Wl,-rpath,${folder} -o ${WORK}/${name}
      COMMAND_ECHO STDOUT COMMAND_ERROR_IS_FATAL ANY)
   execute_process(COMMAND ${WORK}/${name} RESULT_VARIABLE status)
   file(REMOVE ${WORK}/${name})
   if(NOT status EQUAL 0)
      message(FATAL_ERROR "${SOURCE}, compiled by ${compiler}, ended with ${status}")
   endif()
endforeach()
