# SPDX-License-Identifier: BSD-3-Clause
# SYMSDE_PYTHON: the interpreter of the tests; .venv's where ./bootstrap made one.
find_program(SYMSDE_PYTHON NAMES python3 python HINTS ${PROJECT_SOURCE_DIR}/.venv/bin
   DOC "Python (3.11 or later) that runs the tests of the package and of the tree")
if(NOT SYMSDE_PYTHON)
   message(STATUS "No Python: tests of the package and of the tree are skipped")
endif()

# add_python_test(name labels argument...): run Python with the built library, leaving no files in the tree.
# A tool that is not installed makes the test skipped (77), not passed.
function(add_python_test name label)
   if(SYMSDE_PYTHON)
      add_test(NAME ${name} COMMAND ${SYMSDE_PYTHON} ${ARGN})
   else()
      add_test(NAME ${name} COMMAND sh -c "echo skipped: there was no Python when this was configured; exit 77")
   endif()
   set_tests_properties(${name} PROPERTIES
      LABELS "${label}"
      TIMEOUT 3600
      SKIP_RETURN_CODE 77
      ENVIRONMENT "SYMSDE_LIBRARY=$<TARGET_FILE:symsde>;SYMSDE_CACHE=${PROJECT_BINARY_DIR}/formulas;PYTHONDONTWRITEBYTECODE=1;MPLBACKEND=Agg"
      ENVIRONMENT_MODIFICATION "PYTHONPATH=path_list_prepend:${PROJECT_SOURCE_DIR}/python")
endfunction()
