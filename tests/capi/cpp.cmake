# SPDX-License-Identifier: BSD-3-Clause
# Compile SOURCE, a C++17 program, with each compiler of CXX (separated by commas), with strict warnings as errors,
# against headers and library of a build, and run it. FLAGS: the sanitizers of the library. If SYMSDE_INCLUDE is set in
# the environment, it replaces INCLUDE.
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
string(RANDOM name)  # runs of planted faults compile the same test at the same time
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
