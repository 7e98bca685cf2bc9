! SPDX-License-Identifier: BSD-3-Clause
!> Results of streaming observers: how parts of an ensemble merge, and their answers; both group by group.
module symsde_ensemble_observe_observed
   use symsde_base_kinds, only: wp, i8
   use symsde_base_status, only: error_type, raise, incompatible
   use symsde_ensemble_observe_observers, only: new_observer, ngroup
   use symsde_ensemble_observe_streaming, only: streaming_observer, observed_type
   use symsde_ensemble_statistics_path_tree, only: moment_node, moment_tree, insert_node, final_node
   implicit none
   private
   public :: merge_observed, observed_answer

contains

   !> Merge two siblings into the left part, as merge_moments does: a part is the paths j 2^k .. (j+1) 2^k - 1 with k >=
   !> 8.
   subroutine merge_observed(left, right, error)
      type(observed_type), intent(inout) :: left
      type(observed_type), intent(in) :: right
      type(error_type), allocatable, intent(inout) :: error
      class(streaming_observer), allocatable :: observer
      integer(i8) :: m, n
      integer :: k

      call new_observer(observer, left%request, left%of, error)
      if (allocated(error)) return
      if (size(left%counts) /= size(right%counts) .or. size(left%sums) /= size(right%sums) .or. &
          left%request%kind /= right%request%kind .or. left%request%ngroup /= right%request%ngroup) then
         call raise(error, incompatible, 'merge_observed', 'the two parts hold statistics of different kinds or '// &
                    'sizes: merge parts of one run')
         return
      end if
      m = observer%ncount
      n = observer%nsum()
      do k = 0, ngroup(left%request) - 1
         call merge_group(observer, left%counts(k*m + 1:(k + 1)*m), left%sums(k*n + 1:(k + 1)*n), &
                          right%counts(k*m + 1:(k + 1)*m), right%sums(k*n + 1:(k + 1)*n))
      end do
   end subroutine merge_observed

   !> Merge the statistics of a group.
   subroutine merge_group(observer, counts, sums, more_counts, more_sums)
      class(streaming_observer), intent(in) :: observer
      integer(i8), intent(inout) :: counts(:)
      real(wp), intent(inout) :: sums(:)
      integer(i8), intent(in) :: more_counts(:)
      real(wp), intent(in) :: more_sums(:)
      type(moment_tree) :: tree
      type(moment_node) :: table
      real(wp), allocatable :: singles(:)

      associate (n => observer%nsingle)
         call observer%join(counts, sums(:n), more_counts, more_sums(:n))
         if (observer%nrow == 0) return
         call observer%to_table(sums, table)
         call insert_node(tree, table)
         call observer%to_table(more_sums, table)
         table%index = 1
         call insert_node(tree, table)
         call final_node(tree, table)
         singles = sums(:n)
         call observer%to_sums(singles, table, sums)
      end associate
   end subroutine merge_group

   !> Answers and their standard errors; the module of each observer documents their shapes.
   subroutine observed_answer(observed, values, errors, error)
      type(observed_type), intent(in) :: observed
      real(wp), allocatable, intent(out) :: values(:), errors(:)
      type(error_type), allocatable, intent(inout) :: error
      class(streaming_observer), allocatable :: observer
      integer(i8) :: m, n, a
      integer :: k

      call new_observer(observer, observed%request, observed%of, error)
      if (allocated(error)) return
      m = observer%ncount
      n = observer%nsum()
      a = observer%nanswer()
      allocate (values(ngroup(observed%request)*a), errors(ngroup(observed%request)*a))
      do k = 0, ngroup(observed%request) - 1
         call observer%answer(observed%counts(k*m + 1:(k + 1)*m), observed%sums(k*n + 1:(k + 1)*n), &
                              values(k*a + 1:(k + 1)*a), errors(k*a + 1:(k + 1)*a))
      end do
   end subroutine observed_answer

end module symsde_ensemble_observe_observed
