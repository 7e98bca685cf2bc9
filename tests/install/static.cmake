# SPDX-License-Identifier: BSD-3-Clause
# The library as an archive: built with BUILD_SHARED_LIBS=OFF, installed, moved, and linked into programs in Fortran, C
# and C++, by find_package (also for C alone) and by pkg-config. No shared libsymsde is needed at run time, and large
# arrays begin at a cache line.
cmake_minimum_required(VERSION 3.25)

function(run)
   execute_process(COMMAND ${ARGN} COMMAND_ECHO STDOUT COMMAND_ERROR_IS_FATAL ANY)
endfunction()

# run_whole(program): the program does not need libsymsde.so, and runs
function(run_whole program)
   execute_process(COMMAND ldd ${program} OUTPUT_VARIABLE needed COMMAND_ERROR_IS_FATAL ANY)
   if(needed MATCHES "symsde")
      message(FATAL_ERROR "${program} needs a shared library: ${needed}")
   endif()
   run(${program})
endfunction()

file(REMOVE_RECURSE ${WORK}/first ${WORK}/prefix ${WORK}/consumer ${WORK}/alone)
run(${CMAKE_COMMAND} -S ${ROOT} -B ${WORK}/build -G Ninja -D BUILD_SHARED_LIBS=OFF -D SYMSDE_BUILD_TESTING=OFF
   -D SYMSDE_FLAGS=release -D CMAKE_Fortran_COMPILER=${FORTRAN} -D CMAKE_C_COMPILER=${CC})
run(${CMAKE_COMMAND} --build ${WORK}/build)
run(${CMAKE_COMMAND} --install ${WORK}/build --prefix ${WORK}/first)
file(RENAME ${WORK}/first ${WORK}/prefix)

run(${CMAKE_COMMAND} -S ${CONSUMER} -B ${WORK}/consumer -D CMAKE_PREFIX_PATH=${WORK}/prefix
   -D CMAKE_Fortran_COMPILER=${FORTRAN} -D CMAKE_C_COMPILER=${CC} -D WANTED=${VERSION} -G Ninja)
run(${CMAKE_COMMAND} --build ${WORK}/consumer)
run_whole(${WORK}/consumer/consumer_fortran)
run_whole(${WORK}/consumer/consumer_c)
if(CXX)
   run_whole(${WORK}/consumer/consumer_cpp)
endif()

# a project whose only language is C
run(${CMAKE_COMMAND} -S ${CONSUMER}/../alone -B ${WORK}/alone -D CMAKE_PREFIX_PATH=${WORK}/prefix
   -D CMAKE_C_COMPILER=${CC} -G Ninja)
run(${CMAKE_COMMAND} --build ${WORK}/alone)
run_whole(${WORK}/alone/alone)

set(ENV{PKG_CONFIG_PATH} ${WORK}/prefix/${LIBDIR}/pkgconfig)
execute_process(COMMAND pkg-config --cflags --libs "symsde = ${VERSION}"
   OUTPUT_VARIABLE flags OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
separate_arguments(flags UNIX_COMMAND "${flags}")
run(${FORTRAN} ${CONSUMER}/consumer.f90 -o ${WORK}/pkg_fortran ${flags})
run(${CC} ${CONSUMER}/consumer.c -o ${WORK}/pkg_c ${flags})
run_whole(${WORK}/pkg_fortran)
run_whole(${WORK}/pkg_c)

# The library's calls of malloc go to its aligned one; the program's calls do not.
execute_process(COMMAND nm ${WORK}/prefix/${LIBDIR}/libsymsde.a OUTPUT_VARIABLE names COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL " U malloc\n" plain "${names}")
list(LENGTH plain plain)
if(NOT plain EQUAL 1 OR NOT names MATCHES " T symsde_malloc\n" OR NOT names MATCHES " U symsde_malloc\n")
   message(FATAL_ERROR "${plain} objects call malloc, where symsde_malloc alone should")
endif()
