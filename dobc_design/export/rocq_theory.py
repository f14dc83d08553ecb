"""What a Coq file says before it proves anything: the definitions, which do not depend on the problem.

Written for the standard library of Coq 8.16.  The lemmas about them stand in ``rocq_lemmas`` and ``rocq_reals``.
"""

from __future__ import annotations

DEFINITIONS = r"""
Require Import QArith List Arith Bool Lia Reals Qreals Lqa Lra.
Import ListNotations.
Open Scope Q_scope.

(* f 0 + ... + f (k - 1). *)
Fixpoint sum (k : nat) (f : nat -> Q) : Q :=
  match k with O => 0 | S i => sum i f + f i end.

(* x' M x.  A matrix or vector is a function of its indices, which count from 0;
   only the entries with indices below k enter. *)
Definition form (k : nat) (M : nat -> nat -> Q) (x : nat -> Q) : Q :=
  sum k (fun i => sum k (fun j => x i * M i j * x j)).

Definition nonzero (k : nat) (x : nat -> Q) : Prop :=
  exists i, (i < k)%nat /\ ~ x i == 0.

Definition positive_definite (k : nat) (M : nat -> nat -> Q) : Prop :=
  forall x, nonzero k x -> 0 < form k M x.

Definition negative_definite (k : nat) (M : nat -> nat -> Q) : Prop :=
  forall x, nonzero k x -> form k M x < 0.

(* The same for real vectors; Q2R embeds the rationals into the reals. *)
Fixpoint sum_R (k : nat) (f : nat -> R) : R :=
  match k with O => 0%R | S i => (sum_R i f + f i)%R end.

Definition form_R (k : nat) (M : nat -> nat -> Q) (x : nat -> R) : R :=
  sum_R k (fun i => sum_R k (fun j => (x i * Q2R (M i j) * x j)%R)).

Definition nonzero_R (k : nat) (x : nat -> R) : Prop :=
  exists i, (i < k)%nat /\ x i <> 0%R.

Definition positive_definite_R (k : nat) (M : nat -> nat -> Q) : Prop :=
  forall x, nonzero_R k x -> (0 < form_R k M x)%R.

Definition negative_definite_R (k : nat) (M : nat -> nat -> Q) : Prop :=
  forall x, nonzero_R k x -> (form_R k M x < 0)%R.

(* A matrix from its rows. *)
Definition matrix (rows : list (list Q)) (i j : nat) : Q := nth j (nth i rows []) 0.

Definition delta (i j : nat) : Q := if Nat.eqb i j then 1 else 0.

(* Agent `listener` hears agent `speaker`; `slope` is h'(0) times the weight of the arc, m x m. *)
Record arc := Arc { listener : nat; speaker : nat; slope : nat -> nat -> Q }.

(* Agent `pinned` feels -gain (x_i - xbar). *)
Record pin := Pin { pinned : nat; gain : nat -> nat -> Q }.

Definition total {T : Type} (f : T -> Q) (l : list T) : Q := fold_right (fun a s => f a + s) 0 l.
"""

NETWORK = r"""
(* J = dh/de at the consensus: an arc puts its slope at block (listener, speaker) and minus its
   slope at block (listener, listener).  Row i belongs to component (i mod m) of agent (i / m). *)
Definition J (arcs : list arc) (i j : nat) : Q :=
  let a := (i / m)%nat in let c := (i mod m)%nat in
  let b := (j / m)%nat in let d := (j mod m)%nat in
  total (fun each =>
    if Nat.eqb a (listener each)
    then slope each c d * (delta b (speaker each) - delta b (listener each))
    else 0) arcs.

(* K = diag(k_1, ..., k_n), the pinning gains. *)
Definition K (i j : nat) : Q :=
  let a := (i / m)%nat in let c := (i mod m)%nat in
  let b := (j / m)%nat in let d := (j mod m)%nat in
  if Nat.eqb a b then total (fun each => if Nat.eqb a (pinned each) then gain each c d else 0) pins else 0.

(* Lambda = J + J' - (K + K'). *)
Definition Lambda (arcs : list arc) (i j : nat) : Q := J arcs i j + J arcs j i - (K i j + K j i).
"""

OBSERVER = r"""
(* Omega0 = P A + A' P - C' Q' - Q C, with Q = P W written Qm (Coq calls the rationals Q). *)
Definition Omega0 (k l : nat) : Q :=
  sum q (fun j => P k j * A j l) + sum q (fun j => A j k * P j l)
  - sum m (fun c => C c k * Qm l c) - sum m (fun c => Qm k c * C c l).

(* I (x) C. *)
Definition IC (i t : nat) : Q :=
  if Nat.eqb (i / m) (t / q) then C (i mod m) (t mod q) else 0.

(* I (x) B for a block B of size q. *)
Definition blocks (B : nat -> nat -> Q) (s t : nat) : Q :=
  if Nat.eqb (s / q) (t / q) then B (s mod q) (t mod q) else 0.

(* Psi = [[Lambda, I (x) C], [(I (x) C)', I (x) Omega0]], equation (18) (for several modes (28)). *)
Definition offset : nat := (n * m)%nat.
Definition size : nat := (n * m + n * q)%nat.

Definition Psi (arcs : list arc) (i j : nat) : Q :=
  if Nat.ltb i offset
  then if Nat.ltb j offset then Lambda arcs i j else IC i (j - offset)
  else if Nat.ltb j offset then IC j (i - offset) else blocks Omega0 (i - offset) (j - offset).

(* V = e'e + sum over i of eps_i' P eps_i has the matrix diag(I, I (x) P). *)
Definition V (i j : nat) : Q :=
  if Nat.ltb i offset then delta i j
  else if Nat.ltb j offset then 0 else blocks P (i - offset) (j - offset).

(* The closed loop (22) at the consensus, z' = F z with z = (e, eps):
   e' = (J - K) e + (I (x) C) eps,  eps' = (I (x) (A - W C)) eps. *)
Definition estimation (k l : nat) : Q := A k l - sum m (fun c => W k c * C c l).

Definition F (arcs : list arc) (i j : nat) : Q :=
  if Nat.ltb i offset
  then if Nat.ltb j offset then J arcs i j - K i j else IC i (j - offset)
  else if Nat.ltb j offset then 0 else blocks estimation (i - offset) (j - offset).
"""

ALONE = r"""
(* Without a disturbance the condition is that of Lemma 1, Lambda < 0.  It is called Psi here. *)
Definition size : nat := (n * m)%nat.

Definition Psi (arcs : list arc) (i j : nat) : Q := Lambda arcs i j.

(* V = e'e, and the closed loop at the consensus, z' = F z with z = e: e' = (J - K) e. *)
Definition V (i j : nat) : Q := delta i j.

Definition F (arcs : list arc) (i j : nat) : Q := J arcs i j - K i j.
"""

DERIVATIVE = r"""
(* F' V + V F: along z' = F z the derivative of z' V z is z' (F' V + V F) z. *)
Definition derivative (arcs : list arc) (i j : nat) : Q :=
  sum size (fun k => F arcs k i * V k j + V i k * F arcs k j).
"""

RATE = r"""
(* Psi + 2 rate V: where it is negative definite, V decreases faster than exp(-2 rate t). *)
Definition Psi_rate (arcs : list arc) (i j : nat) : Q := Psi arcs i j + 2 * rate * V i j.
"""
