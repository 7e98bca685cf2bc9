! SPDX-License-Identifier: BSD-3-Clause
!> Parameters of a user's functions that differ by path: path first + i of a run has row i of a table (i/n where n
!> neighbours share one, row_paths of the options), or all paths have its only row.
!>
!> In place of the user pointer the functions get the address of c_lanes (symsde_lanes of symsde.h), which has the
!> parameters of the lanes of this call and the user pointer. A view of the model knows its paths (base/lane_paths), and
!> keeps the parameters of its last call, for further calls with the same lanes. If the model itself is called, as by
!> probes, every lane has the parameters of the first path.
!>
!> Private to its family.
module symsde_model_user_path_parameters
   use, intrinsic :: iso_c_binding, only: c_loc, c_null_ptr, c_ptr
   use symsde_base_kinds, only: wp, i8
   use symsde_base_lane_paths, only: lane_paths, most_deep
   implicit none
   private
   public :: path_parameters, lane_call

   real(wp), parameter :: small = 1.0e-3_wp   !! in the place of zero, where a probe asks for it

   !> symsde_lanes
   type, bind(c) :: c_lanes
      type(c_ptr) :: parameters = c_null_ptr  !! [nparameter][nlane]
      type(c_ptr) :: user = c_null_ptr
   end type c_lanes

   !> The parameters of the lanes of a call, in the form in which the functions get them.
   type :: lane_room
      integer(i8) :: number = 0          !! number of the list of paths (base/lane_paths); 0 = not filled
      integer :: nlane = 0
      type(c_lanes) :: given
      real(wp), allocatable :: values(:) !! (nlane*nparameter)
   end type lane_room

   !> A call of a user's function for some lanes: enter returns it, leave ends it.
   type :: lane_call
      type(c_ptr) :: user = c_null_ptr                    !! the user pointer of this call
      type(lane_room), pointer, private :: own => null()  !! parameters for this call alone
   contains
      procedure :: leave
   end type lane_call

   !> A table of parameters, and the number of models that share it.
   type :: common_table
      real(wp), allocatable :: values(:, :)  !! (nrow, nparameter)
      integer :: owners = 1
   end type common_table

   type :: path_parameters
      logical :: act = .false.  !! whether there is a table; otherwise calls need neither enter nor leave
      type(common_table), pointer, private :: common => null()
      type(lane_room), pointer, private :: rooms(:) => null()  !! rooms of a view: a room for each open list of paths
   contains
      procedure :: set
      procedure :: nrow
      procedure :: share
      procedure :: see_paths
      procedure :: enter
      procedure :: release
   end type path_parameters

contains

   !> Take a copy of these values (nrow, nparameter). info is not 0 if memory does not suffice.
   subroutine set(self, values, info)
      class(path_parameters), intent(inout) :: self
      real(wp), intent(in) :: values(:, :)
      integer, intent(out) :: info

      call self%release()
      allocate (self%common)
      allocate (self%common%values, source=values, stat=info)
      self%act = info == 0
      if (info /= 0) call self%release()
   end subroutine set

   !> Number of rows; 0 = no table: the functions have their own parameters, the same for all paths.
   pure integer(i8) function nrow(self)
      class(path_parameters), intent(in) :: self

      nrow = 0
      if (associated(self%common)) nrow = size(self%common%values, 1, i8)
   end function nrow

   !> Share the table of another model.
   subroutine share(self, other)
      class(path_parameters), intent(inout) :: self
      type(path_parameters), intent(in) :: other

      if (associated(self%common, other%common)) return
      call self%release()
      if (.not. associated(other%common)) return
      self%common => other%common
      self%act = .true.
      !$omp atomic update
      self%common%owners = self%common%owners + 1
   end subroutine share

   !> Keep the parameters of the last call, in a view, which a single thread uses.
   subroutine see_paths(self)
      class(path_parameters), intent(inout) :: self

      allocate (self%rooms(0:most_deep))
   end subroutine see_paths

   !> Begin a call for nlane lanes: call%user is the address of the parameters of these lanes and of the functions' user
   !> pointer. The caller ends the call by leave.
   subroutine enter(self, paths, nlane, user, call)
      class(path_parameters), intent(in) :: self
      type(lane_paths), pointer, intent(in) :: paths
      integer, intent(in) :: nlane
      type(c_ptr), intent(in) :: user
      type(lane_call), intent(out) :: call
      type(lane_room), pointer :: room
      integer(i8) :: number
      integer :: depth

      number = 0
      if (associated(self%rooms)) then
         call paths%which(depth, number)
         room => self%rooms(depth)
      else
         allocate (call%own)
         room => call%own
      end if
      if (number == 0 .or. room%number /= number .or. room%nlane /= nlane) then
         call gather(self%common, paths, nlane, room)
         room%number = number
         room%given%user = user
      end if
      call%user = c_loc(room%given)
   end subroutine enter

   !> End a call: free the parameters that were allocated for it alone.
   subroutine leave(self)
      class(lane_call), intent(inout) :: self

      if (associated(self%own)) deallocate (self%own)
   end subroutine leave

   !> Copy the rows of the paths of these lanes from the table.
   subroutine gather(table, paths, nlane, room)
      type(common_table), intent(in) :: table
      type(lane_paths), pointer, intent(in) :: paths
      integer, intent(in) :: nlane
      type(lane_room), intent(inout), target :: room
      integer(i8) :: row(nlane)
      integer(i8) :: most
      integer :: a, b, k, n

      row = 0
      if (associated(paths)) call paths%find_places(nlane, row)
      most = size(table%values, 1, i8)
      n = nlane*size(table%values, 2)
      if (allocated(room%values)) then
         if (size(room%values) < n) deallocate (room%values)
      end if
      if (.not. allocated(room%values)) allocate (room%values(n))
      if (row(1) >= 0 .and. row(1) + nlane <= most .and. all(row(2:) - row(:nlane - 1) == 1)) then
         do k = 1, size(table%values, 2)
            room%values((k - 1)*nlane + 1:k*nlane) = table%values(row(1) + 1:row(1) + nlane, k)
         end do
      else
         row = max(1_i8, min(row + 1, most))
         b = 0
         do while (b < nlane)  ! neighbours often share a row
            a = b + 1
            b = a
            do while (b < nlane)
               if (row(b + 1) /= row(a)) exit
               b = b + 1
            end do
            do k = 1, size(table%values, 2)
               room%values((k - 1)*nlane + a:(k - 1)*nlane + b) = table%values(row(a), k)
            end do
         end do
      end if
      if (associated(paths)) then
         if (paths%moves_zeros) where (abs(room%values(:n)) <= 0) room%values(:n) = small
      end if
      room%nlane = nlane
      room%given%parameters = c_loc(room%values)
   end subroutine gather

   !> Leave the table, which its last owner frees, and free the rooms.
   subroutine release(self)
      class(path_parameters), intent(inout) :: self
      integer :: left, i

      if (associated(self%rooms)) then
         do i = 0, most_deep  ! gfortran 12 frees the array of rooms, but not their components
            if (allocated(self%rooms(i)%values)) deallocate (self%rooms(i)%values)
         end do
         deallocate (self%rooms)
      end if
      if (.not. associated(self%common)) return
      !$omp atomic capture
      self%common%owners = self%common%owners - 1
      left = self%common%owners
      !$omp end atomic
      if (left == 0) deallocate (self%common)
      nullify (self%common)
      self%act = .false.
   end subroutine release

end module symsde_model_user_path_parameters
