#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# finmath-lib 6.0.19 (Maven Central): TimeDiscretizationFromArray. Wants java 17 and mvn.
# Guess: (0.0, 1000, dt) are 1000 steps of dt.
# Seen: times are rounded to multiples of 1/8760, an hour in years, and those that fall together are one: dt = 0.001 has steps of
#     0.00091 and 0.00103, dt = 1e-4 has 876 steps, dt = 1e-5 has 88 steps of 1.14e-4. Another tick can be given with a list.
# For users of stochastic integrators: orders of convergence stop at dt = 1e-4, and loops over 1000 steps end at another time.
set -euo pipefail
here=$(mktemp -d)
trap 'rm -rf "$here"' EXIT
cd "$here"
mvn -q -B -Dmaven.repo.local="$here/m2" dependency:get -Dartifact=net.finmath:finmath-lib:6.0.19 > log 2>&1
cat > Steps.java <<'END'
import net.finmath.time.TimeDiscretization;
import net.finmath.time.TimeDiscretizationFromArray;

public class Steps {
    public static void main(String[] arguments) {
        for (double dt : new double[] {1e-2, 1e-3, 1e-4, 1e-5}) {
            TimeDiscretization times = new TimeDiscretizationFromArray(0.0, 1000, dt);
            double low = 1, high = 0;
            for (int i = 0; i < times.getNumberOfTimeSteps(); i++) {
                low = Math.min(low, times.getTimeStep(i));
                high = Math.max(high, times.getTimeStep(i));
            }
            System.out.printf(java.util.Locale.ROOT, "%g %d %.6g %.6g %.6g%n", dt, times.getNumberOfTimeSteps(), low, high,
                times.getTime(times.getNumberOfTimeSteps()));
        }
    }
}
END
java -cp "$(find m2/net/finmath m2/org/apache/commons -name '*.jar' | tr '\n' ':')" Steps.java > table
echo "finmath-lib 6.0.19: dt, steps, smallest, largest, last time"
cat table
awk '{ steps[NR] = $2; low[NR] = $3; high[NR] = $4 }
    END { exit !(steps[2] == 1000 && steps[3] == 876 && steps[4] == 88 && high[2] / low[2] > 1.1 && high[4] > 1.1e-4) }' table
