use pid_runtime::robot;

robot! {
    pub robot Cart {
        params { mc: kg = 1.0 in 0.1..=5.0; mp: kg = 0.2 in 0.01..=1.0; l: m = 0.5 in 0.1..=1.0; g: m/s^2 = 9.81 fixed; }
        coordinates x: m, th: rad;
        lagrangian = 0.5*(mc + mp)*v.x^2 + mp*l*v.x*v.th*cos(th) + 0.5*mp*l^2*v.th^2 - mp*g*l*cos(th);
        per joint th { dry: N*m = 0.1 in 0.0..=1.0; sharp: s/rad = 10 in 1..=50; force = -dry*tanh(sharp*v); }
        limit ops 75;
        emit { dynamics, first_derivatives, second_derivatives }
    }
}

fn main() {}
