# SPDX-License-Identifier: BSD-3-Clause
# A machine with compilers, CMake, Make and LAPACK alone: the tree must configure there, and tests in Python must be
# skipped. MPI's compiler wrapper is there without Fortran modules, as other Debian packages install it.
cmake_minimum_required(VERSION 3.25)

file(REMOVE_RECURSE ${WORK})
file(WRITE ${WORK}/bin/mpifort "#!/bin/sh
case $1 in -show*) echo gfortran -I${WORK}/nowhere -lmpi;; *) exit 1;; esac
")
file(CHMOD ${WORK}/bin/mpifort PERMISSIONS OWNER_READ OWNER_EXECUTE)
set(ENV{PATH} "${WORK}/bin:$ENV{PATH}")
execute_process(COMMAND ${CMAKE_COMMAND} -S ${ROOT} -B ${WORK} -G "Unix Makefiles" -D SYMSDE_PYTHON=OFF
   -D SYMSDE_PKG_CONFIG=OFF -D SYMSDE_MESON=OFF -D CMAKE_Fortran_COMPILER=${FORTRAN} -D CMAKE_C_COMPILER=${CC}
   COMMAND_ERROR_IS_FATAL ANY)
# one test from each folder that adds tests in Python
set(names check_funit|house_tree|capi_header|python_test_cpu|example_first_agrees|mutants_fit)
execute_process(COMMAND ${CMAKE_CTEST_COMMAND} --test-dir ${WORK} -R "^(${names})$"
   OUTPUT_VARIABLE said COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "[*]Skipped" skipped "${said}")
list(LENGTH skipped count)
if(NOT count EQUAL 6)
   message(FATAL_ERROR "${count} tests are skipped without Python, where 6 should be:\n${said}")
endif()

# a Python that does not exist is no error, either
set(ENV{PATH} "")
set(PROJECT_SOURCE_DIR ${WORK})
include(${ROOT}/tests/python.cmake)
if(SYMSDE_PYTHON)
   message(FATAL_ERROR "${SYMSDE_PYTHON} is found where there is none to be found")
endif()
