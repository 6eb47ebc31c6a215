-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;

-- Purpose:  Keeps an output of an entity from the end of a step to that of the next one, whatever it shows in between.
-- Timing:   word_o is word_i in a clock with show_i = 1, and the last such word in all others.

entity pe_held_output is
  generic (
    BITS : positive -- word
  );
  port (
    clk_i  : in    std_ulogic;                           -- clock
    show_i : in    std_ulogic;                           -- the entity shows the word of a step
    word_i : in    std_ulogic_vector(BITS - 1 downto 0); -- what it shows
    word_o : out   std_ulogic_vector(BITS - 1 downto 0)  -- word of the step
  );
end entity pe_held_output;

architecture rtl of pe_held_output is

  signal word : std_ulogic_vector(BITS - 1 downto 0) := (others => '0');

begin

  p_word : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (show_i = '1') then
        word <= word_i;
      end if;
    end if;

  end process p_word;

  word_o <= word_i when show_i = '1' else
            word;

end architecture rtl;
