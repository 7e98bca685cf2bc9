! SPDX-License-Identifier: BSD-3-Clause
!> Names that pFUnit's module funit exports besides its assertions. A suite that uses funit cannot reuse these names for
!> its own procedures, types or variables; here they are constants without use, so that a clash is seen without pFUnit,
!> too.
module funit_names
   implicit none
   public

   integer, parameter, private :: taken = 0
   integer, parameter :: run = taken, generic_run = taken, initialize = taken, finalize = taken
   integer, parameter :: stub = taken, get_context = taken, loadtests_interface = taken
   integer, parameter :: test = taken, testsuite = taken, testmethod = taken, testcase = taken
   integer, parameter :: testresult = taken, testrunner = taken, basetestrunner = taken
   integer, parameter :: testlistener = taken, testannotation = taken, disable = taken
   integer, parameter :: sourcelocation = taken, expectation = taken, subject = taken, predicate = taken
   integer, parameter :: wascalled = taken, wasnotcalled = taken, wascalledonce = taken
   integer, parameter :: throw = taken, catch = taken, catchnext = taken, anyexceptions = taken
   integer, parameter :: fail = taken, conformable = taken, nonconformable = taken

end module funit_names
