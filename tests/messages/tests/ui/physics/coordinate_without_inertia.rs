use pid_runtime::robot;

robot! {
    pub robot Cart {
        params { mc: kg = 1.0 in 0.1..=5.0; mp: kg = 0.2 in 0.01..=1.0; l: m = 0.5 in 0.1..=1.0; g: m/s^2 = 9.81 fixed; }
        coordinates x: m, th: rad;
        lagrangian = 0.5*mp*l^2*v.th^2 - mp*g*l*cos(th);
        input push: N; force on x = push;
        emit { dynamics }
    }
}

fn main() {}
